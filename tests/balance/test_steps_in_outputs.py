"""How exact a program takes outputs that step, and what a force that steps is told."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import hbnlp
from hbnlp import AliasingWarning, HarmonicBalance, System


def with_step(level: float) -> HarmonicBalance:
    system = System(
        [[1.0]],
        [[0.05]],
        [[1.0]],
        nonlinear_force=lambda q, v, tau, p: [0.1 * q[0] ** 3],
        forcing=lambda tau, p: [0.2 * ca.cos(tau)],
        outputs={"side": lambda s: ca.sign(s.q[0] - level)},
    )
    return HarmonicBalance(system, 5)


@pytest.mark.parametrize("level", [0.0, 0.125, 0.4, 0.7])
def test_a_program_takes_a_step_to_one_sample_for_each_passage(level):
    problem = with_step(level)
    solution = hbnlp.solve(problem, at={"omega": 0.9})
    with pytest.warns(AliasingWarning, match="5e-4 of its height for each time it is passed"):
        taken = np.ravel(solution(problem.output("side")))
    exact = solution.harmonics("side")
    height, passages = 2.0, 2
    assert taken[0] == pytest.approx(exact[0].real, abs=5e-4 * height * passages)
    modulus = np.hypot(taken[1::2], taken[2::2])
    np.testing.assert_allclose(modulus, np.abs(exact[1:]), rtol=0.0, atol=5e-4 * height * passages)


def test_a_force_that_jumps_with_tau_alone_is_told_to_be_forcing():
    def system(**signals):
        return System([[1.0]], [[0.2]], [[1.0]], **signals)

    jumps = system(nonlinear_force=lambda q, v, tau, p: [0.1 * q[0] ** 3 - 0.1 * ca.sign(ca.sin(tau))])
    with pytest.raises(hbnlp.ConvergenceError, match="belongs into forcing, where jumps are integrated exactly"):
        hbnlp.solve(HarmonicBalance(jumps, 3), at={"omega": 1.1})
    right = system(
        nonlinear_force=lambda q, v, tau, p: [0.1 * q[0] ** 3],
        forcing=lambda tau, p: [0.1 * ca.sign(ca.sin(tau))],
    )
    assert hbnlp.solve(HarmonicBalance(right, 3), at={"omega": 1.1}).converged
