"""Observers of traces, sweeps and searches: what they are told, the progress bar, and saving every so often."""

import io
import itertools
import logging

import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.tracing import trace
from hbnlp.core.callbacks import Autosave, Progress, ProgressBar, StopTracing
from hbnlp.core.errors import TaskError
from hbnlp.core.kinds import End
from hbnlp.systems import duffing
from hbnlp.testing import check_branch


@pytest.fixture(scope="module")
def problem():
    return HarmonicBalance(duffing(), 3)


def told(problem, span, **options):
    """What a callback saw of a trace, and the branch."""
    seen = []
    branch = trace(problem, "omega", span, stability=None, callbacks=[seen.append], **options)
    check_branch(branch)
    return seen, branch


def test_a_callback_sees_every_point_and_the_end(problem):
    seen, branch = told(problem, (0.5, 1.6))
    assert [p.counts["points"] for p in seen] == [*range(1, len(branch) + 1), len(branch)]
    np.testing.assert_array_equal([p.value for p in seen[:-1]], branch.parameter)
    assert [p.done for p in seen] == [False] * len(branch) + [True]
    assert seen[-1].counts["folds"] == 2
    assert all(p.name == "omega" for p in seen)
    assert [p.counts["folds"] for p in seen] == sorted(p.counts["folds"] for p in seen)


def test_the_fraction_rises_to_one_also_through_folds(problem):
    for span in ((0.5, 1.6), (1.6, 0.5), (0.1, 10.0)):
        seen, _ = told(problem, span)
        fraction = [p.fraction for p in seen]
        assert fraction == sorted(fraction)
        assert fraction[0] == 0.0
        assert fraction[-1] == 1.0


def test_the_fraction_is_of_the_logarithm_over_more_than_a_decade(problem):
    seen, branch = told(problem, (0.1, 10.0))
    k = np.argmin(np.abs(branch.parameter - 1.0))
    expected = np.log10(branch.parameter[: k + 1] / 0.1).max() / 2.0
    assert seen[k].fraction == pytest.approx(expected)


def test_a_callback_may_take_all_points_so_far_as_a_branch(problem):
    lengths = []

    def look(progress):
        branch = progress.result()
        check_branch(branch)
        lengths.append((len(branch), progress.counts["points"]))

    trace(problem, "omega", (0.5, 0.8), stability=None, callbacks=[look])
    assert all(a == b for a, b in lengths)
    assert len(lengths) > 3


def test_several_callbacks_are_called_in_turn_and_each_may_stop_the_trace(problem):
    calls = []

    def second(progress):
        calls.append("second")
        if progress.counts["points"] == 3 and not progress.done:
            raise StopTracing

    branch = trace(problem, "omega", (0.5, 1.6), callbacks=[lambda p: calls.append("first"), second], stability=None)
    assert branch.end is End.STOPPED
    assert len(branch) == 3
    assert calls[:6] == ["first", "second"] * 3


def test_a_resumed_trace_counts_on(problem):
    branch = trace(problem, "omega", (0.5, 1.2), stability=None)
    seen, longer = told(problem, (0.5, 1.6), resume=branch)
    assert seen[0].counts["points"] == len(branch) + 1
    assert seen[-1].counts["points"] == len(longer)


def test_the_progress_bar_names_the_parameter_counts_points_and_folds_and_ends_at_the_whole(problem):
    text = io.StringIO()
    branch = trace(problem, "omega", (0.5, 1.6), stability=None, callbacks=[ProgressBar(file=text, mininterval=0.0)])
    shown = text.getvalue()
    assert "tracing omega" in shown
    assert f"{len(branch)} points, 2 folds" in shown
    assert "100%" in shown
    assert shown.endswith("\n")


def test_a_progress_bar_serves_one_trace_after_another(problem):
    text = io.StringIO()
    bar = ProgressBar(file=text)
    for _ in range(2):
        trace(problem, "omega", (0.5, 0.7), stability=None, callbacks=[bar])
    assert text.getvalue().count("100%") >= 2


def test_a_progress_bar_shows_counts_while_the_fraction_stands_still():
    """A fold curve is half done for long; tqdm by itself then waits for a step as large as those before."""
    text = io.StringIO()
    bar = ProgressBar(file=text, mininterval=0.0)
    for points in range(40):
        part, counts = min(0.5, 0.1 * points), {"folds": points}
        common = {"task": "following", "name": "omega", "value": 1.0, "done": False, "result": lambda: None}
        bar(Progress(fraction=part, counts=counts, **common))
    assert "39 folds" in text.getvalue()


def test_a_progress_bar_is_closed_when_the_trace_is_stopped_or_fails(problem):
    text = io.StringIO()
    bar = ProgressBar(file=text)

    def stop(progress):
        if progress.counts["points"] == 4:
            raise StopTracing

    trace(problem, "omega", (0.5, 1.6), stability=None, callbacks=[bar, stop])
    assert text.getvalue().endswith("\n")


def test_the_default_prints_nothing(problem, capfd):
    trace(problem, "omega", (0.5, 0.8))
    assert capfd.readouterr() == ("", "")


def test_autosave_writes_at_the_end_whatever_its_interval(problem, tmp_path):
    path = tmp_path / "branch.npz"
    branch = trace(problem, "omega", (0.5, 1.6), stability=None, callbacks=[Autosave(path, seconds=3600.0)])
    loaded = Branch.load(path)
    np.testing.assert_array_equal(loaded.coefficients, branch.coefficients)
    assert loaded.end is End.SPAN_END


def test_autosave_writes_every_so_often(problem, tmp_path, monkeypatch):
    now = [0.0]
    monkeypatch.setattr("hbnlp.core.callbacks.time.monotonic", lambda: now[0])
    path, written = tmp_path / "branch.npz", []
    autosave = Autosave(path, seconds=10.0)

    def clock(_):
        now[0] += 1.0
        written.append(path.exists() and len(Branch.load(path)))

    trace(problem, "omega", (0.5, 1.6), stability=None, callbacks=[autosave, clock])
    changes = [b for a, b in itertools.pairwise(written) if a != b]
    assert changes[:3] == [11, 21, 31]


def test_autosave_keeps_the_file_when_a_trace_is_stopped(problem, tmp_path):
    path = tmp_path / "branch.npz"

    def stop(progress):
        if progress.counts["points"] == 9:
            raise StopTracing

    branch = trace(problem, "omega", (0.5, 1.6), stability=None, callbacks=[Autosave(path, seconds=3600.0), stop])
    assert len(branch) == 9
    loaded = Branch.load(path)
    assert len(loaded) == 9
    assert loaded.end is End.STOPPED


def test_autosave_keeps_the_file_and_the_bar_is_closed_when_a_trace_fails(problem, tmp_path):
    path, text = tmp_path / "branch.npz", io.StringIO()

    def fail(progress):
        if progress.counts["points"] == 9:
            raise RuntimeError("from a callback")

    callbacks = [fail, Autosave(path, seconds=3600.0), ProgressBar(file=text)]
    with pytest.raises(TaskError, match="from a callback"):
        trace(problem, "omega", (0.5, 1.6), stability=None, callbacks=callbacks)
    loaded = Branch.load(path)
    assert len(loaded) == 9
    assert loaded.end is End.ERROR
    check_branch(loaded)
    assert text.getvalue().endswith("\n")


def test_a_callback_that_fails_at_the_end_does_not_lose_the_branch(problem, caplog):
    def fail(progress):
        if progress.done:
            raise RuntimeError("at the end")

    branch = trace(problem, "omega", (0.5, 0.8), stability=None, callbacks=[fail])
    assert branch.end is End.SPAN_END
    assert "at the end" in caplog.text


def test_a_failure_to_save_is_logged_with_the_path(problem, tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        trace(
            problem, "omega", (0.5, 0.7), stability=None, callbacks=[Autosave(tmp_path / "no" / "b.npz", seconds=1e-9)]
        )
    assert "autosave failed, tracing omega goes on and it is tried again: " in caplog.text
    assert "b.npz" in caplog.text


@pytest.mark.parametrize("seconds", [0.0, -1.0])
def test_an_interval_that_is_not_positive_is_refused(seconds):
    with pytest.raises(ValueError, match=f"seconds is {seconds}; give a finite number greater than 0, the time"):
        Autosave("branch.npz", seconds=seconds)


def test_progress_is_a_frozen_record():
    progress = Progress(
        task="tracing omega", name="omega", value=1.0, fraction=0.5, counts={}, done=False, result=lambda: None
    )
    with pytest.raises(AttributeError):
        progress.value = 2.0
