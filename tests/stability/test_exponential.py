"""Multipliers where the mean is exact and only what varies is collocated, against integration and plain collocation."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hbnlp import System
from hbnlp.stability.integrals import Polynomials
from hbnlp.stability.modes import Modes
from hbnlp.stability.multipliers import FloquetEvaluator
from hbnlp.stability.result import Floquet
from hbnlp.stability.spectra import distance

N = 5
FORCES = {
    "cubic": lambda q, v: q[0] ** 3,
    "velocity": lambda q, v: q[0] ** 2 * v[0],
    "no polynomial": lambda q, v: ca.tanh(2.0 * q[0]),
    "two entries": lambda q, v: (q[0] - q[1]) ** 3,
}


def beam(force, fastest=40.0, damping=0.02, unit=1.0):
    """A frame of coupled coordinates with frequencies 1 to ``fastest``; displacements are counted in a unit."""
    basis = np.linalg.qr(np.random.default_rng(3).normal(size=(N, N)))[0]
    frequencies = np.geomspace(1.0, fastest, N)
    matrices = [basis @ np.diag(d) @ basis.T for d in (np.ones(N), damping * frequencies, frequencies**2)]
    return System(*matrices, nonlinear_force=lambda q, v, tau, p: [force(unit * q, unit * v) / unit, *[0.0] * (N - 1)])


def integrated(system, x, omega):
    q, v, p = system.q, system.v, system.p
    tau = system.tau
    rates = [ca.Function("d", [q, v, tau, p], [ca.densify(ca.jacobian(system.force, s))]) for s in (q, v)]
    mass, damping, stiffness, _ = (np.array(m) for m in system.state_matrices([omega]))
    harmonics = np.arange(1, (x.shape[1] - 1) // 2 + 1)

    def rate(t, z):
        c, s = np.cos(harmonics * omega * t), np.sin(harmonics * omega * t)
        at = np.concatenate([[1.0], np.column_stack([c, s]).ravel()])
        slope = np.concatenate([[0.0], np.column_stack([-harmonics * omega * s, harmonics * omega * c]).ravel()])
        by_q, by_v = (f(x @ at, x @ slope, omega * t, omega).full() for f in rates)
        z = z.reshape(2 * N, 2 * N)
        low = -np.linalg.solve(mass, (stiffness + by_q) @ z[:N] + (damping + by_v) @ z[N:])
        return np.concatenate([z[N:], low]).ravel()

    run = solve_ivp(rate, (0.0, 2 * np.pi / omega), np.eye(2 * N).ravel(), method="DOP853", rtol=1e-10, atol=1e-12)
    return np.linalg.eigvals(run.y[:, -1].reshape(2 * N, 2 * N))


@pytest.mark.parametrize(("name", "omega", "damping"), [(n, 0.7, 0.02) for n in FORCES] + [("cubic", 0.3, 1e-3)])
def test_few_varying_entries_beside_fast_modes_agree_with_integration(name, omega, damping, monkeypatch):
    used = []
    make = Modes.of
    monkeypatch.setattr(Modes, "of", lambda *a: used.append(make(*a)) or used[-1])
    system = beam(FORCES[name], damping=damping)
    x = 0.3 * np.random.default_rng(1).normal(size=(N, 7))
    result = FloquetEvaluator(system, 1, 3)(x, [omega])
    assert used[0] is not None
    assert result.converged
    assert distance(result.multipliers, integrated(system, x, omega)) <= result.error + 1e-8


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("fastest", [40.0, 400.0])
def test_it_is_plain_collocation_in_any_units(fastest, unit, monkeypatch):
    system = beam(FORCES["cubic"], fastest, damping=0.6, unit=unit)
    x = 0.3 / unit * np.random.default_rng(2).normal(size=(N, 7))
    result = FloquetEvaluator(system, 1, 3)(x, [0.8])
    monkeypatch.setattr(Modes, "of", lambda *a: None)
    plain = FloquetEvaluator(system, 1, 3)(x, [0.8])
    assert distance(result.multipliers, plain.multipliers) <= result.error + plain.error
    assert result.n_intervals < plain.n_intervals


def test_a_defective_mean_is_left_to_plain_collocation():
    """Two masses that move freely beside a fast oscillator: double eigenvalues zero without eigenvectors."""
    stiffness = np.diag([0.0, 0.0, 4.0, 9.0, 1e4])
    system = System(np.eye(N), 0.0 * np.eye(N), stiffness, nonlinear_force=lambda q, v, tau, p: [*[0.0] * 4, q[4] ** 3])
    x = 0.3 * np.random.default_rng(2).normal(size=(N, 7))
    evaluator = FloquetEvaluator(system, 1, 3)
    variation = evaluator._linearised.variation(x, np.array([0.8]))
    assert evaluator._constant_part(evaluator._linearised.plant(np.array([0.8])), variation, None) is None
    assert evaluator(x, [0.8]).converged


@pytest.mark.parametrize("nodes", [1, 4, 8, 10])
def test_both_ways_to_integrate_meet(nodes):
    """On both sides of where sums by parts take over from quadrature, integrals are continuous."""
    z = 20.0 * np.exp(1j * np.linspace(0.5 * np.pi, np.pi, 7))
    inside, outside = (Polynomials.of(nodes).integrals(z * (1.0 + sign * 1e-12))[1] for sign in (-1, 1))
    np.testing.assert_allclose(inside, outside, atol=1e-11)


@pytest.mark.parametrize("nodes", [3, 8])
@pytest.mark.parametrize("tol", [1e-3, 1e-6])
def test_one_mesh_tells_its_own_error(tol, nodes):
    """Against plain collocation to a far smaller tolerance."""
    for seed in range(4):
        system = beam(FORCES["two entries"], fastest=(4.0, 15.0)[seed % 2], damping=0.01)
        x = 0.4 * np.random.default_rng(seed).normal(size=(N, 7))
        result = FloquetEvaluator(system, 1, 3, Floquet(tol=tol, nodes=nodes))(x, [0.6])
        reference = FloquetEvaluator(system, 1, 3, Floquet(tol=1e-10))(x, [0.6])
        assert result.constant_part is not None
        assert result.converged
        assert distance(result.multipliers, reference.multipliers) <= 2.0 * result.error + reference.error


def test_a_neighbour_gives_its_modes_and_the_same_multipliers(monkeypatch):
    system = beam(FORCES["cubic"])
    x = 0.3 * np.random.default_rng(1).normal(size=(N, 7))
    evaluator = FloquetEvaluator(system, 1, 3)
    first = evaluator(x, [0.7])
    alone = evaluator(1.05 * x, [0.72])
    made = []
    make = Modes.of
    monkeypatch.setattr(Modes, "of", lambda *a: made.append(0) or make(*a))
    beside = evaluator(1.05 * x, [0.72], near=first)
    assert not made
    assert beside.constant_part is first.constant_part
    assert distance(beside.multipliers, alone.multipliers) <= beside.error + alone.error
    x[:, 0] += 2.0
    far = evaluator(x, [0.72], near=first)
    assert made
    assert far.constant_part is not first.constant_part
    assert distance(far.multipliers, evaluator(x, [0.72]).multipliers) <= 2.0 * far.error
