"""Multipliers where a coefficient switches: their error is within what is said of it, and within the tolerance."""

import itertools

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hbnlp
from hbnlp.fourier import basis_derivatives
from hbnlp.stability.grading import graded
from hbnlp.stability.modes import Modes
from hbnlp.stability.multipliers import FloquetEvaluator
from hbnlp.stability.result import Floquet

WIDTH = 0.02
SHAPES = {  # of s = cos(tau + phase) - level, by CasADi and by numpy
    "sign": (ca.sign, np.sign),
    "if_else": (lambda s: ca.if_else(s > 0.0, 1.0, 0.0), lambda s: float(s > 0.0)),
    "gap": (lambda s: ca.fmax(s, 0.0), lambda s: max(s, 0.0)),
    "tanh": (lambda s: ca.tanh(s / WIDTH), lambda s: np.tanh(s / WIDTH)),
    "wide tanh": (lambda s: ca.tanh(s / 0.2), lambda s: np.tanh(s / 0.2)),
}


def exact(shape, stiffness, damping, depth, phase, level):
    """Return the multipliers by an integration that stops and starts where the shape switches."""

    def rate(tau, y):
        return [y[1], -damping * y[1] - (stiffness + depth * shape(np.cos(tau + phase) - level)) * y[0]]

    switches = [(angle - phase) % (2.0 * np.pi) for angle in (np.arccos(level), -np.arccos(level))]
    around = [s + d for s in switches for d in (-8.0 * WIDTH, 0.0, 8.0 * WIDTH)]
    ends = sorted({0.0, 2.0 * np.pi, *np.clip(around, 0.0, 2.0 * np.pi)})
    monodromy = np.eye(2)
    for begin, end in itertools.pairwise(ends):
        inside = (begin + 1e-13, end - 1e-13)
        columns = [
            solve_ivp(rate, inside, column, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1] for column in np.eye(2)
        ]
        monodromy = np.array(columns).T @ monodromy
    return np.linalg.eigvals(monodromy)


@pytest.mark.parametrize("tol", [1e-3, 1e-6])
@pytest.mark.parametrize("name", SHAPES)
def test_the_error_is_within_its_estimate(name, tol):
    by_casadi, by_numpy = SHAPES[name]
    rng = np.random.default_rng(5)
    for _ in range(4):
        stiffness, damping, depth = rng.uniform(0.3, 9.0), rng.uniform(0.01, 0.3), rng.uniform(0.1, 2.0)
        phase, level = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-0.8, 0.8)
        system = hbnlp.System(
            [[1.0]],
            [[damping]],
            [[stiffness]],
            nonlinear_force=lambda q, v, tau, p, d=depth, ph=phase, c=level: [
                d * by_casadi(ca.cos(tau + ph) - c) * q[0]
            ],
            forcing=lambda tau, p: [1.0],
        )
        values = system.parameters.values({"omega": 1.0})
        result = FloquetEvaluator(system, 1, 2, Floquet(tol=tol))(np.zeros((1, 5)), values)
        known = exact(by_numpy, stiffness, damping, depth, phase, level)
        errors = [
            np.abs(result.multipliers - order).max() / max(1.0, np.abs(order).max()) for order in (known, known[::-1])
        ]
        assert result.converged
        assert result.n_intervals < 400
        assert min(errors) <= result.error + 1e-10  # the reference's own
        assert min(errors) <= tol


def test_a_jump_is_found_wherever_it_is():
    for place in np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, 50):
        mesh = graded(lambda theta, at=place: np.where(theta < at, 0.0, 1.0)[:, None], 9, 8, tol=1e-3, limit=500)
        lengths = 2.0 * np.pi * 0.5**mesh.levels / 9
        assert mesh.resolved
        assert lengths.sum() == pytest.approx(2.0 * np.pi, rel=1e-13)
        ahead = lengths[mesh.entries[:, -1, 0] < 0.5].sum()
        assert abs(ahead - place) < 1e-10


def test_coefficients_that_cannot_be_resolved_are_not_called_so():
    rng = np.random.default_rng(0)
    mesh = graded(lambda theta: rng.standard_normal((theta.size, 1)), 9, 8, tol=1e-3, limit=500)
    assert not mesh.resolved
    assert len(mesh.levels) <= 500


def test_damping_that_varies_counts_in_every_unit_of_time():
    """As numbers f_v is small beside f_q in fast units, and its series was cut off as if it were so in the equation."""
    width, friction = 0.05, 0.05
    results = []
    for second in (1.0, 1e7, 1e-7):
        system = hbnlp.System(
            [[1.0]],
            [[0.05 / second]],
            [[1.0 / second**2]],
            nonlinear_force=lambda q, v, tau, p, s=second: [
                (0.3 * q[0] ** 3 + friction * ca.tanh(s * v[0] / width)) / s**2
            ],
            forcing=lambda tau, p, s=second: [0.5 / s**2 * ca.cos(tau)],
        )
        solution = hbnlp.solve(hbnlp.HarmonicBalance(system, 25), at={"omega": 0.8 / second})
        results.append(hbnlp.floquet(solution))
    tau = 2.0 * np.pi * np.arange(20_000) / 20_000
    velocity = 0.8 * solution.coefficients[0] @ basis_derivatives(tau, 25).T
    damping = 0.05 + friction / width / np.cosh(velocity / width) ** 2
    liouville = np.exp(-damping.mean() * 2.0 * np.pi / 0.8)
    for result in results:
        assert result.n_intervals == results[0].n_intervals
        np.testing.assert_allclose(result.multipliers, results[0].multipliers, atol=1e-9)
        assert result.multipliers.prod() == pytest.approx(liouville, abs=result.error)


def coulomb(width, n_harmonics, omega, amplitude):
    """The result about a given motion with friction of a width, and the determinant by Liouville's formula."""
    friction, damping = 0.05, 0.05
    system = hbnlp.System(
        [[1.0]],
        [[damping]],
        [[1.0]],
        nonlinear_force=lambda q, v, tau, p: [0.3 * q[0] ** 3 + friction * ca.tanh(v[0] / width)],
        forcing=lambda tau, p: [0.5 * ca.cos(tau)],
    )
    x = np.zeros((1, 2 * n_harmonics + 1))
    x[0, 1:7] = amplitude * np.array([1.0, 0.3, 0.0, 0.0, 0.08, -0.05])
    tau = 2.0 * np.pi * np.arange(400_000) / 400_000
    velocity = omega * basis_derivatives(tau, 3) @ x[0, :7]
    by_v = damping + friction / width / np.cosh(np.clip(velocity / width, -300.0, 300.0)) ** 2
    result = FloquetEvaluator(system, 1, n_harmonics)(x, system.parameters.ordered({"omega": omega}))
    return result, np.exp(-by_v.mean() * 2.0 * np.pi / omega)


@pytest.mark.parametrize("modes", [True, False])
@pytest.mark.parametrize("n_harmonics", [5, 13])
@pytest.mark.parametrize("width", [0.003, 0.01, 0.03, 0.1, 0.3])
def test_friction_of_any_width_is_within_its_estimate(width, n_harmonics, modes, monkeypatch):
    """Also where its peak lies between all samples of the derivative, and on either kind of mesh."""
    if not modes:
        monkeypatch.setattr(Modes, "of", lambda *a: None)
    for omega, amplitude in ((0.3, 3.0), (0.8, 1.0), (2.0, 1.0), (2.0, 0.05)):
        result, determinant = coulomb(width, n_harmonics, omega, amplitude)
        assert result.converged
        assert abs(result.multipliers.prod() - determinant) <= 2.0 * result.error + 1e-10  # of the sum over samples


def test_what_jumps_with_the_phase_alone_costs_no_graded_mesh():
    """A load within the nonlinear force: it has no derivative, hence switches nothing."""
    system = hbnlp.System(
        [[1.0]], [[0.1]], [[1.0]], nonlinear_force=lambda q, v, tau, p: [q[0] ** 3 + ca.sign(ca.cos(tau + 0.1))]
    )
    x = np.array([[0.0, 0.4, 0.3, 0.0, 0.0]])
    smooth = hbnlp.System([[1.0]], [[0.1]], [[1.0]], nonlinear_force=lambda q, v, tau, p: [q[0] ** 3])
    results = [FloquetEvaluator(each, 1, 2)(x, [0.9]) for each in (system, smooth)]
    assert results[0].n_intervals == results[1].n_intervals
    np.testing.assert_allclose(results[0].multipliers, results[1].multipliers, atol=1e-12)
