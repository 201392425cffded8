"""A process that is killed at any time has at most its last point not in its file, and the work goes on from there."""

import subprocess
import sys
import time
from pathlib import Path

import killed
import numpy as np
import pytest

import hbnlp
from hbnlp import dns
from hbnlp.systems import duffing
from hbnlp.testing import check_branch


def kill(verb, folder, seconds):
    """Kill a verb some time after it said its second point, and return how many it had said by then."""
    command = [sys.executable, killed.__file__, verb, str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        first = [process.stdout.readline() for _ in range(2)]
        time.sleep(seconds)
        process.kill()
        said = [*first, *process.stdout.read().splitlines(keepends=True)]
    assert process.returncode < 0, "it was done before it was killed"
    return max(int(line) for line in said if line.endswith("\n"))


def at_random(verb):
    return np.random.default_rng(len(verb)).uniform(0.0, 0.6, 3).tolist()


def only_the_file(folder):
    return [path.name for path in Path(folder).iterdir()] == ["file.npz"]


@pytest.mark.parametrize("seconds", at_random("trace"))
def test_a_trace_that_is_killed_loses_one_point_at_most_and_is_resumed(tmp_path, seconds):
    said = kill("trace", tmp_path, seconds)
    kept = hbnlp.Branch.load(tmp_path / "file.npz", problem=killed.problem())
    assert said - 1 <= len(kept) <= said + 1
    check_branch(kept)
    resumed = hbnlp.trace(
        killed.problem(), "omega", (0.5, 1.6), resume=kept, callbacks=[hbnlp.Autosave(tmp_path / "file.npz")]
    )
    check_branch(resumed)
    assert resumed.end is hbnlp.End.SPAN_END
    np.testing.assert_array_equal(resumed.coefficients[: len(kept)], kept.coefficients)
    assert only_the_file(tmp_path)


@pytest.mark.parametrize("seconds", at_random("sweep"))
def test_a_sweep_that_is_killed_loses_one_value_at_most_and_goes_on_from_its_last(tmp_path, seconds):
    said = kill("sweep", tmp_path, seconds)
    kept = hbnlp.Sweep.load(tmp_path / "file.npz", problem=killed.problem())
    assert said - 1 <= len(kept) <= said + 1
    np.testing.assert_array_equal(kept.parameter, killed.FREQUENCIES[: len(kept)])
    rest = killed.FREQUENCIES[len(kept) : len(kept) + 5]
    rest = hbnlp.sweep(killed.problem(), "omega", rest, start=kept.solution(-1))
    whole = hbnlp.sweep(killed.problem(), "omega", killed.FREQUENCIES[: len(kept) + 5])
    np.testing.assert_allclose(whole.coefficients[-5:], rest.coefficients, atol=1e-9)
    rest.save(tmp_path / "file.npz")
    assert only_the_file(tmp_path)


@pytest.mark.parametrize("seconds", at_random("search"))
def test_a_search_that_is_killed_loses_one_start_at_most_and_goes_on_as_if_it_had_not_been(tmp_path, seconds):
    said = kill("search", tmp_path, seconds)
    kept = hbnlp.SolutionSet.load(tmp_path / "file.npz", problem=killed.problem())
    assert said - 1 <= kept.n_tried <= said + 1
    assert not kept.complete
    values, method, made = {"omega": 1.2}, hbnlp.Search(n_starts=kept.n_tried + 15), []
    resumed = hbnlp.find_all(
        killed.problem(),
        at=values,
        method=method,
        known=kept,
        callbacks=[hbnlp.Autosave(tmp_path / "file.npz"), lambda progress: made.append(progress.done)],
    )
    whole = hbnlp.find_all(killed.problem(), at=values, method=method)
    assert made.count(False) == 15
    assert resumed.complete
    assert resumed.state == whole.state
    np.testing.assert_array_equal([s.coefficients for s in resumed], [s.coefficients for s in whole])
    assert hbnlp.SolutionSet.load(tmp_path / "file.npz").state == whole.state
    assert only_the_file(tmp_path)


@pytest.mark.parametrize("seconds", at_random("study")[:1])
def test_a_study_that_is_killed_loses_one_point_at_most_and_goes_on(tmp_path, seconds):
    said = kill("study", tmp_path, seconds)
    kept = hbnlp.Study.load(tmp_path, problem=killed.problem())
    assert said - 1 <= sum(kept.done) <= said + 1
    made = []
    callbacks = [lambda told: made.append(told.done)]
    whole = hbnlp.study(killed.task(), over=killed.FORCES, folder=tmp_path, callbacks=callbacks)
    assert made.count(False) == len(kept) - sum(kept.done)
    assert whole.complete
    for i in np.flatnonzero(kept.done):
        np.testing.assert_array_equal(kept[int(i)].coefficients, whole[int(i)].coefficients)
    assert not list(tmp_path.glob("*.part"))


def test_an_integration_that_is_killed_loses_one_window_at_most_and_goes_on_from_its_state(tmp_path):
    said = kill("settle", tmp_path, 0.3)
    kept = hbnlp.TimeResponse.load(tmp_path / "file.npz")
    assert said - 1 <= kept.n_periods <= said + 1
    options = {"at": {"omega": 0.7}, "method": kept.method, "periodic_tol": 1e-300, "throw": False}
    rest = hbnlp.integrate(duffing(), start=kept, max_periods=3, **options)
    whole = hbnlp.integrate(duffing(), max_periods=kept.n_periods + 3, **options)
    np.testing.assert_array_equal(rest.q, whole.q)
    np.testing.assert_array_equal(rest.state, whole.state)


@pytest.mark.parametrize("seconds", at_random("run"))
def test_a_flow_run_that_is_killed_loses_one_step_at_most_and_goes_on_bit_for_bit(tmp_path, seconds):
    said = kill("run", tmp_path, seconds)
    flow = killed.flow()
    dns.load_state(flow, tmp_path / "file.npz")
    assert said - 1 <= flow.steps <= said + 1
    whole = killed.flow()
    whole.run(whole.dt * flow.steps)
    np.testing.assert_array_equal(flow.psi, whole.psi)
    flow.step()
    whole.step()
    np.testing.assert_array_equal(flow.gamma, whole.gamma)
    dns.save_state(flow, tmp_path / "file.npz")
    assert only_the_file(tmp_path)
