"""A force with a term that is narrower than the samples that it begins with."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import hbnlp
from hbnlp import HarmonicBalance, System


@pytest.mark.parametrize(("at", "width"), [(0.9, 0.003), (0.5, 0.01)])
def test_a_narrow_term_of_the_force_is_seen(at, width):
    system = System(
        [[1.0]],
        [[0.2]],
        [[1.0]],
        nonlinear_force=lambda q, v, tau, p: [0.1 * q[0] ** 3 + 0.2 * ca.exp(-(((q[0] - at) / width) ** 2))],
        forcing=lambda tau, p: [0.3 * ca.cos(tau)],
    )
    found, right = (
        hbnlp.solve(HarmonicBalance(system, 7, n_samples=count), at={"omega": 1.1}).coefficients
        for count in (None, 20001)
    )
    np.testing.assert_allclose(found, right, rtol=0.0, atol=1e-7)
