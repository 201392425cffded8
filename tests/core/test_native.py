"""Compiled functions on numpy memory: what is bound stays alive, what does not fit is refused."""

import gc
import threading

import casadi as ca
import numpy as np
import pytest

from hbnlp.core.native import PerThread, bound


def squares():
    x = ca.SX.sym("x", 3)
    return ca.Function("squares", [x], [x**2, ca.sum1(x)])


def test_a_bound_function_reads_and_writes_the_arrays_themselves():
    x, squared, total = np.array([1.0, 2.0, 3.0]), np.zeros((1, 3)), np.zeros(1)
    evaluate = bound(squares(), [x], [squared, total])
    evaluate()
    np.testing.assert_array_equal(squared, [[1.0, 4.0, 9.0]])
    x *= 2.0
    evaluate()
    np.testing.assert_array_equal(squared, [[4.0, 16.0, 36.0]])
    assert total[0] == 12.0


def test_the_memory_lives_as_long_as_what_evaluates():
    """CasADi keeps bare pointers: with 2000 functions whose arrays nobody else holds, freed memory would show."""
    results = [np.zeros(3) for _ in range(2000)]
    evaluations = [
        bound(squares(), [np.array([1.0, 2.0, float(k)])], [squared, np.zeros(1)]) for k, squared in enumerate(results)
    ]
    gc.collect()
    rubbish = [np.full(3, np.nan) for _ in range(4000)]
    for evaluate in evaluations:
        evaluate()
    np.testing.assert_array_equal(results, [[1.0, 4.0, float(k) ** 2] for k in range(2000)])
    assert np.isnan(rubbish).all()


@pytest.mark.parametrize(
    ("arguments", "results", "message"),
    [
        ([np.zeros(2)], [np.zeros(3), np.zeros(1)], r"argument 0 of squares is an array of shape \(2,\)"),
        ([np.zeros(3)], [np.zeros(3), np.zeros(2)], r"result 1 of squares .* 1 floats side by side are needed"),
        ([np.zeros(3, dtype=int)], [np.zeros(3), np.zeros(1)], "type int64"),
        ([np.zeros((3, 2))[:, 0]], [np.zeros(3), np.zeros(1)], "side by side"),
        ([np.zeros(3)], [np.zeros(3)], "squares has 2 results; 1 arrays were given"),
    ],
)
def test_memory_that_does_not_fit_is_refused(arguments, results, message):
    with pytest.raises(ValueError, match=message):
        bound(squares(), arguments, results)


def test_every_thread_has_its_own_object_and_keeps_it():
    mine = PerThread(list)
    assert mine() is mine()
    others = []
    thread = threading.Thread(target=lambda: others.extend([mine(), mine()]))
    thread.start()
    thread.join()
    assert others[0] is others[1] is not mine()
