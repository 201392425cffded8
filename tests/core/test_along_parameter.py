"""Every record tells the values of a parameter, the one that varies and others, by its name."""

import numpy as np
import pytest

import hbnlp


@pytest.fixture(scope="module")
def branch():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(), 3)
    return hbnlp.trace(problem, "omega", (0.9, 1.4), at={"force": 0.2}, stability=None)


def records(branch):
    problem = branch.problem
    tolerant = hbnlp.HarmonicBalance(problem.system, tolerance=1e-2)
    return [
        branch,
        hbnlp.trace(tolerant, "omega", (0.9, 1.4), at={"force": 0.2}, stability=None),
        hbnlp.sweep(problem, "omega", [0.7, 0.8], at={"force": 0.2}),
        hbnlp.sweep(problem.system, "omega", [0.7], at={"force": 0.2}, max_periods=50),
    ]


@pytest.mark.parametrize("which", range(4))
def test_values_and_harmonics_of_every_record(branch, which):
    record = records(branch)[which]
    np.testing.assert_array_equal(record.values("omega"), record.parameter)
    np.testing.assert_array_equal(record.values("force"), np.full(len(record), 0.2))
    np.testing.assert_array_equal(record.harmonics("x"), record.amplitudes[:, 0])
    assert len(record) == record.parameter.size > 0
    with pytest.raises(KeyError, match="unknown parameter 'forc'; did you mean 'force'"):
        record.values("forc")
    with pytest.raises(TypeError, match=r"values\(0\): give the name of a parameter"):
        record.values(0)


def test_values_along_a_curve_of_folds(branch):
    curve = hbnlp.follow(branch.folds[0], "force", span=(0.19, 0.21))
    np.testing.assert_array_equal(curve.values("omega"), curve.first)
    np.testing.assert_array_equal(curve.values("force"), curve.second)
    np.testing.assert_array_equal(curve.values("cubic"), np.full(len(curve), 0.1))
    with pytest.raises(TypeError, match="give the name of a parameter"):
        curve.values(0)
