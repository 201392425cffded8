"""Studies: what a loop gives, in the order of the grid, whoever does the work and whatever becomes of a part of it."""

import functools
import json
import logging
import multiprocessing
import os
import signal
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import jobs
import numpy as np
import pytest

import hbnlp
from hbnlp.studies.storing import described

OVER = {"damping_ratio": [0.1, 0.15], "force": [0.1, 0.2, 0.3]}
NUMBERS = {"number": list(range(6))}


@pytest.fixture(scope="module")
def pool():
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as workers:
        yield workers


@pytest.fixture(scope="module")
def problem():
    return hbnlp.HarmonicBalance(hbnlp.systems.duffing(), 5)


def trace_of(problem, **options):
    return functools.partial(hbnlp.trace, problem, "omega", (0.5, 1.6), **options)


def same(one, other):
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.coefficients, b.coefficients)
        np.testing.assert_array_equal(a.multipliers, b.multipliers)
        assert a.parameters == b.parameters


def test_processes_give_what_a_loop_gives_and_what_the_verb_gives(problem, pool):
    loop = hbnlp.study(trace_of(problem), over=OVER)
    same(loop, hbnlp.study(trace_of(problem), over=OVER, executor=pool))
    assert loop.shape == (2, 3)
    assert loop.points[4] == {"damping_ratio": 0.15, "force": 0.2}
    same([loop[1, 1]], [hbnlp.trace(problem, "omega", (0.5, 1.6), at={"damping_ratio": 0.15, "force": 0.2})])
    assert loop[-1] is loop.results[5] is loop[1, 2]


def test_results_are_in_the_order_of_the_points_whatever_ends_first(pool):
    assert [*hbnlp.study(jobs.slow_first, over=NUMBERS, executor=pool)] == [0, 10, 20, 30, 40, 50]


def test_threads_may_share_what_cannot_be_sent():
    lock = threading.Lock()
    with ThreadPoolExecutor(2) as threads:
        study = hbnlp.study(lambda at: (lock.locked(), at["number"]), over=NUMBERS, executor=threads)
    assert [*study] == [(False, i) for i in range(6)]


def test_values_that_a_partial_has_stay_beside_those_of_the_point(problem):
    study = hbnlp.study(
        functools.partial(hbnlp.solve, problem, at={"omega": 0.7, "force": 9.0}), over=[{"force": 0.1}, {"force": 0.2}]
    )
    assert [solution.parameters["force"] for solution in study] == [0.1, 0.2]
    assert [solution.parameters["omega"] for solution in study] == [0.7, 0.7]


@pytest.mark.parametrize("by_processes", [False, True])
def test_a_task_that_fails_is_data(pool, by_processes):
    study = hbnlp.study(jobs.own, over=OVER, executor=pool if by_processes else None)
    assert study.complete
    assert [*study.errors] == [2, 5]
    assert study.results[2] is None
    assert str(study.errors[2]) == "ValueError: the force is too large"
    assert "in own" in study.errors[2].traceback
    assert repr(study).splitlines()[-2:] == [
        "  6 of 6 points done, 2 failed",
        "  first failure at {'damping_ratio': 0.1, 'force': 0.3}: ValueError: the force is too large",
    ]


def test_a_result_that_cannot_be_sent_is_an_error_of_its_point(pool):
    study = hbnlp.study(jobs.unsendable, over=NUMBERS, executor=pool)
    assert [*study.errors] == [1]
    assert "pickle" in study.errors[1].message


def test_workers_that_are_gone_end_the_study_with_what_there_is():
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as workers:
        with pytest.raises(hbnlp.TaskError) as caught:
            hbnlp.study(jobs.ending, over=NUMBERS, executor=workers)
        assert caught.value.result.results[:3] == (0, 1, 2)
        assert not caught.value.result.complete
        assert "a worker ended: there was no memory left" in caught.value.__cause__.__notes__[0]


# -- folders -----------------------------------------------------------------------------------------------------------


def stopping(after):
    def stop(progress):
        if progress.counts["done"] == after:
            raise hbnlp.StopTracing

    return stop


def test_a_study_that_was_stopped_goes_on_from_its_folder(problem, tmp_path, caplog):
    folder, made = tmp_path / "study", []

    def task(at):
        made.append(at)
        return hbnlp.solve(problem, at={**at, "omega": 0.7})

    with caplog.at_level(logging.ERROR):
        stopped = hbnlp.study(task, over=OVER, folder=folder, callbacks=[stopping(4)])
    assert stopped.message == "stopped by a callback: 4 of 6 points done"
    assert len(list(folder.glob("*.Solution.npz"))) == 4
    whole = hbnlp.study(task, over=OVER, folder=folder)
    assert whole.complete
    assert made == list(whole.points)
    loaded = hbnlp.Study.load(folder, problem=problem)
    for one, other, direct in zip(whole, loaded, hbnlp.study(task, over=OVER), strict=True):
        np.testing.assert_array_equal(one.coefficients, direct.coefficients)
        np.testing.assert_array_equal(other.coefficients, direct.coefficients)
        assert other.problem is problem
    assert repr(loaded) == repr(whole)


def test_errors_are_kept_and_tried_again(tmp_path):
    tried = []

    def task(at):
        tried.append(at["number"])
        if at["number"] == 2 and len(tried) < 10:
            raise ZeroDivisionError("once")
        return at["number"]

    for n_tried in (6, 7, 8, 9):
        study = hbnlp.study(task, over=NUMBERS, folder=tmp_path)
        assert len(tried) == n_tried
        assert str(study.errors[2]) == str(hbnlp.Study.load(tmp_path).errors[2]) == "ZeroDivisionError: once"
    assert not hbnlp.study(task, over=NUMBERS, folder=tmp_path).errors
    assert [*hbnlp.Study.load(tmp_path)] == [0, 1, 2, 3, 4, 5]
    assert not list(tmp_path.glob("*error*"))


def test_a_folder_of_another_study_is_refused_and_says_why(problem, tmp_path):
    task = functools.partial(hbnlp.solve, problem, at={"omega": 0.7})
    hbnlp.study(task, over={"force": [0.1, 0.2]}, folder=tmp_path / "a")
    before = sorted(path.name for path in (tmp_path / "a").iterdir())
    with pytest.raises(ValueError, match="belongs to another study, with other points"):
        hbnlp.study(task, over={"force": [0.1, 0.3]}, folder=tmp_path / "a")
    other = functools.partial(hbnlp.solve, problem, at={"omega": 0.8})
    with pytest.raises(ValueError, match=r"with other arguments of hbnlp\.solve: at"):
        hbnlp.study(other, over={"force": [0.1, 0.2]}, folder=tmp_path / "a")
    with pytest.raises(ValueError, match=r"with the task hbnlp\.solve, not jobs\.own"):
        hbnlp.study(jobs.own, over={"force": [0.1, 0.2]}, folder=tmp_path / "a")
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == before
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "thesis.tex").touch()
    with pytest.raises(hbnlp.LoadError, match="not the folder of a study"):
        hbnlp.study(task, over={"force": [0.1, 0.2]}, folder=tmp_path / "b")
    with pytest.raises(hbnlp.LoadError, match="not the folder of a study"):
        hbnlp.Study.load(tmp_path / "b")
    with pytest.raises(FileNotFoundError):
        hbnlp.Study.load(tmp_path / "nothing")


def test_the_same_problem_made_anew_is_the_same_study(tmp_path):
    for _ in range(2):
        problem = hbnlp.HarmonicBalance(hbnlp.systems.chain(2), 3)
        hbnlp.study(
            trace_of(problem, method=hbnlp.PseudoArclength(max_points=3)), over={"force": [0.1]}, folder=tmp_path
        )


def test_a_damaged_file_is_computed_again(tmp_path, caplog):
    hbnlp.study(jobs.slow_first, over=NUMBERS, folder=tmp_path)
    (tmp_path / "000002.values.npz").write_bytes(b"damaged")
    assert [*hbnlp.study(jobs.slow_first, over=NUMBERS, folder=tmp_path)] == [0, 10, 20, 30, 40, 50]
    assert "a damaged file of a study counts as not there" in caplog.text
    (tmp_path / "study.json").write_text("{")
    with pytest.raises(hbnlp.LoadError, match="not a readable study"):
        hbnlp.study(jobs.slow_first, over=NUMBERS, folder=tmp_path)


RESULT = {
    "number": 0.1 + 0.2,
    "none": None,
    "complex": 1.0 + 2.0j,
    "array": np.array([[1.0, np.nan], [np.inf, -0.0]]),
    "single": np.float32(0.1),
    "texts": ("a", ["b", True, 3]),
    "mapping": {"inner": np.array(["x", "yz"]), "complex": np.array([1j])},
}


def result_at(at):
    assert at == {"case": "only"}
    return RESULT


def test_values_are_loaded_as_they_were_without_pickle(tmp_path):
    hbnlp.study(result_at, over=[{"case": "only"}], folder=tmp_path)
    (loaded,) = hbnlp.Study.load(tmp_path)
    assert repr(loaded) == repr(RESULT)
    assert loaded["single"].dtype == np.float32
    assert json.loads((tmp_path / "study.json").read_text())["over"] == [{"case": "only"}]


def test_what_no_file_can_hold_ends_the_study_and_says_what_can(tmp_path):
    with pytest.raises(TypeError, match="a record of hbnlp that can be saved, a number, a text"):
        hbnlp.study(nothing_for_a_file, over=NUMBERS, folder=tmp_path)


def nothing_for_a_file(at):
    return object() if at else None


def at_both(at):
    return 1000 * at["a"] + at["b"]


def test_a_grid_in_another_order_is_another_study(tmp_path):
    hbnlp.study(at_both, over={"a": [1, 2], "b": [10, 20]}, folder=tmp_path)
    with pytest.raises(ValueError, match="another study, with other points"):
        hbnlp.study(at_both, over={"b": [10, 20], "a": [1, 2]}, folder=tmp_path)


class Power:
    def __init__(self, exponent):
        self.exponent = exponent

    def __call__(self, at):
        return at["number"] ** self.exponent

    def run(self, at):
        return self(at)


@pytest.mark.parametrize("task", [Power, lambda exponent: Power(exponent).run], ids=["object", "method"])
def test_an_object_that_is_called_is_known_by_all_that_it_is(tmp_path, task):
    assert [*hbnlp.study(task(2), over=NUMBERS, folder=tmp_path)] == [0, 1, 4, 9, 16, 25]
    assert hbnlp.study(task(2), over=NUMBERS, folder=tmp_path).complete
    with pytest.raises(ValueError, match=r"other arguments of .*: self"):
        hbnlp.study(task(3), over=NUMBERS, folder=tmp_path)


def test_what_can_be_another_under_the_same_name_has_no_folder(tmp_path, problem):
    for task, said in (
        (lambda at: at["number"], "a lambda is known by its name alone"),
        (trace_of(problem, events={"level": lambda s: s.amplitude_squared("x") - 1.0}), "its argument 'events' is"),
    ):
        with pytest.raises(ValueError, match=said):
            hbnlp.study(task, over=NUMBERS, folder=tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_equal_arguments_are_described_alike_whatever_their_order_and_identity():
    one = functools.partial(jobs.own, first={"a", "b", "c"}, second={"x": [1.0, ("y",)], "z": None})
    other = functools.partial(jobs.own, second={"z": None, "x": [1.0, ("".join("y"),)]}, first={"c", "b", "a"})
    assert described(one) == described(other)
    assert described(functools.partial(jobs.own, first=[1, 2])) != described(functools.partial(jobs.own, first=[2, 1]))


def test_a_task_that_wants_to_leave_the_program_has_failed(pool):
    for executor in (None, pool):
        study = hbnlp.study(jobs.leaving, over={"number": [2]}, executor=executor)
        assert (study.errors[0].kind, study.errors[0].message) == ("SystemExit", "2")


def test_a_disc_that_is_full_ends_nothing(tmp_path, caplog, monkeypatch):
    def full(*_):
        raise hbnlp.SaveError(28, "no space")

    monkeypatch.setattr("hbnlp.studies.storing.save_values", full)
    assert hbnlp.study(jobs.slow_first, over=NUMBERS, folder=tmp_path).complete
    assert caplog.text.count("could not be saved") == 1


def test_a_study_in_memory_is_saved_as_one_with_a_folder_is(tmp_path):
    study = hbnlp.study(jobs.own, over=OVER)
    study.save(tmp_path / "a")
    loaded = hbnlp.Study.load(tmp_path / "a")
    assert repr(loaded) == repr(study)
    assert hbnlp.study(jobs.own, over=OVER, folder=tmp_path / "a").complete


# -- Ctrl-C ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def _interruptible():
    """A process started in the background ignores Ctrl-C; Python then does not raise KeyboardInterrupt."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("_interruptible")
def test_a_task_that_was_interrupted_is_not_taken_for_done(problem, tmp_path):
    task = functools.partial(jobs.interrupted, problem)
    study = hbnlp.study(task, over={"force": [0.1, 0.2, 0.3]}, folder=tmp_path)
    assert study.done == (True, False, False)
    assert study.message == "interrupted: 1 of 3 points done"
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["000000.Branch.npz", "study.json"]


@pytest.mark.usefixtures("_interruptible")
def test_an_interrupt_while_workers_work_keeps_what_is_done(pool, caplog):
    def interrupt(progress):
        if progress.counts["done"] == 2 and not progress.done:
            threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT)).start()

    study = hbnlp.study(jobs.slow_first, over={"number": [5, 5.5, *[0.1 + i / 100 for i in range(30)]]}, executor=pool,
                        callbacks=[interrupt])  # fmt: skip
    assert study.message.startswith("interrupted: ")
    assert f"study: {study.message}" in caplog.text
    assert 2 <= sum(study.done) < 32
    assert [r for r in study if r is not None] == [
        10 * p["number"] for p, done in zip(study.points, study.done, strict=True) if done
    ]


# -- what is given -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ({}, "over is {}; give values by name"),
        ([], "over is"),
        ({"force": []}, r"over\['force'\] is \[\]; give a list"),
        ({"force": 0.1}, r"over\['force'\] is 0.1; give a list"),
        ({"force": [0.1, 0.1]}, "give each value once"),
        ({"force": [0.1, np.nan]}, r"over\['force'\]\[1\] is nan; give finite numbers"),
        ([{"force": 0.1}, {"omega": 0.1}], r"over\[1\] is .*; give a value for each of force"),
        ([{"force": None}], r"over\[0\]\['force'\] is None"),
    ],
)
def test_points_that_are_none_are_refused(over, message):
    with pytest.raises(ValueError, match=message):
        hbnlp.study(jobs.own, over=over)


def test_places_outside_the_grid_are_refused():
    study = hbnlp.study(jobs.own, over=OVER)
    for index in (6, (0, 3), (0,), 1.5):
        with pytest.raises(ValueError, match="index is"):
            study[index]
