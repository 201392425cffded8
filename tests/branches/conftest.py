"""What several files here start from: the folded branch of a Duffing oscillator, and a detached one."""

import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.tracing import trace
from hbnlp.solutions.solving import solve
from hbnlp.systems import duffing, tuned_absorber


@pytest.fixture(scope="module")
def problem():
    """x'' + .05 x' + x + .1 x^3 = .18 cos w t: bent to the right, folds at w = 1.1157 and 1.2696."""
    return HarmonicBalance(duffing(), 5)


@pytest.fixture(scope="module")
def branch(problem):
    """All of its branch, with both folds."""
    return trace(problem, "omega", (0.5, 1.6))


@pytest.fixture(scope="module")
def absorber():
    """A forcing between the birth of the isola, .1230, and its merging with the main branch, .1807."""
    return HarmonicBalance(tuned_absorber(force=0.15), 5)


@pytest.fixture(scope="module")
def isola_start(absorber):
    """A motion on the isola; the first harmonics [0, cos, sin] of host and absorber are from a search over starts."""
    return solve(absorber, at={"omega": 1.9}, start=[[0.0, -1.04, 1.44], [0.0, 0.64, -0.92]])


@pytest.fixture
def raising_at():
    """Make a callback that raises an error once there are so many points."""

    def make(count, error):
        def callback(progress):
            if progress.counts["points"] == count and not progress.done:
                raise error

        return callback

    return make


@pytest.fixture
def assert_same():
    """Hold two branches to be equal in all that is recorded."""

    def compare(one, other):
        for name in (
            *("parameter", "coefficients", "amplitudes", "arclength", "residual", "iterations", "n_samples"),
            *("multipliers", "stable", "stability_error", "stability_converged"),
        ):
            a, b = getattr(one, name), getattr(other, name)
            assert (a is None) == (b is None), name
            if a is not None:
                np.testing.assert_array_equal(a, b, err_msg=name)
                assert a.dtype == b.dtype, name
        for name in (
            *("name", "span", "end", "message", "parameter_names", "system_name", "output_names", "periods", "refused"),
        ):
            assert getattr(one, name) == getattr(other, name), name
        assert dict(one.parameters) == dict(other.parameters)
        assert len(one.special_points) == len(other.special_points)
        for p, q in zip(one.special_points, other.special_points, strict=True):
            assert (p.kind, p.value, p.bracket, p.index, p.refined) == (q.kind, q.value, q.bracket, q.index, q.refined)
            assert p.multiplier == q.multiplier
            assert p.breaks == q.breaks
            assert repr(p) == repr(q)
            assert dict(p.sensitivity) == dict(q.sensitivity)
            np.testing.assert_array_equal(p.solution.coefficients, q.solution.coefficients)
            np.testing.assert_array_equal(p.solution.amplitudes, q.solution.amplitudes)
            assert dict(p.solution.parameters) == dict(q.solution.parameters)
            assert dict(p.solution.statistics) == dict(q.solution.statistics)
            assert (p.null is None) == (q.null is None)
            if p.null is not None:
                np.testing.assert_array_equal(p.null, q.null)

    return compare
