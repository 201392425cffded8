"""A cluster of Dask does what a loop does."""

import functools
import warnings

import jobs
import numpy as np
import pytest

import hbnlp

distributed = pytest.importorskip("distributed")
OVER = {"damping_ratio": [0.1, 0.15], "force": [0.1, 0.2, 0.3]}


@pytest.fixture(scope="module")
def executor():
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client.get_executor()


def test_a_cluster_gives_what_a_loop_gives(executor, tmp_path):
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(), 5)
    task = functools.partial(hbnlp.trace, problem, "omega", (0.5, 1.6))
    loop = hbnlp.study(task, over=OVER)
    study = hbnlp.study(task, over=OVER, executor=executor, folder=tmp_path)
    for one, other in zip(loop, study, strict=True):
        np.testing.assert_array_equal(one.coefficients, other.coefficients)
        np.testing.assert_array_equal(one.multipliers, other.multipliers)
    assert loop.to_xarray().identical(study.to_xarray())
    assert len(list(tmp_path.glob("*.Branch.npz"))) == 6


def test_an_error_on_a_cluster_is_data(executor):
    study = hbnlp.study(jobs.own, over=OVER, executor=executor)
    assert [*study.errors] == [2, 5]
    assert str(study.errors[2]) == "ValueError: the force is too large"


def test_more_points_than_workers_come_back_in_order_from_a_function_of_this_file(executor):
    factor = 3.0
    study = hbnlp.study(lambda at: factor * at["n"], over={"n": list(range(60))}, executor=executor)
    assert [*study] == [3.0 * n for n in range(60)]


def test_a_study_that_is_stopped_cancels_what_has_not_begun(executor):
    def stop(_):
        raise hbnlp.StopTracing

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        study = hbnlp.study(
            jobs.slow_first, over={"number": [i / 10 for i in range(30)]}, executor=executor, callbacks=[stop]
        )
    assert 1 <= sum(study.done) < 30


def test_a_study_that_is_made_again_is_done_again(executor):
    def draw(at):
        return at["n"] + np.random.default_rng().random()

    once, again = (hbnlp.study(draw, over={"n": [1, 2]}, executor=executor) for _ in range(2))
    assert not {*once} & {*again}
