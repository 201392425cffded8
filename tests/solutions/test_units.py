"""A system in any consistent units of length, time, mass and lag states gives the same numbers."""

from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hbnlp
from hbnlp import design
from hbnlp.branches.folds import fold_by_program
from hbnlp.testing import check_branch


class Units(NamedTuple):
    """How many of the new units one of the old ones is."""

    length: float = 1.0
    time: float = 1.0
    mass: float = 1.0
    lag: float = 1.0

    @property
    def force(self) -> float:
        return self.mass * self.length / self.time**2

    @property
    def sizes(self) -> dict[str, float]:
        """Of the parameters."""
        return {"omega": 1.0 / self.time, "force": self.force, "cubic": self.force / self.length**3}


def duffing(u):
    return hbnlp.System(
        [[u.mass]],
        [[0.05 * u.mass / u.time]],
        [[u.mass / u.time**2]],
        nonlinear_force=lambda q, v, tau, p: [p.cubic * q[0] ** 3],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"force": 0.18 * u.sizes["force"], "cubic": 0.1 * u.sizes["cubic"]},
    )


def with_lags(u):
    """Return two masses, a preload, a cubic spring on both, and two states that lag behind the accelerations."""
    stiffness = u.mass / u.time**2
    return hbnlp.System(
        np.diag([1.0, 0.2]) * u.mass,
        np.array([[0.06, -0.02], [-0.02, 0.02]]) * u.mass / u.time,
        np.array([[1.3, -0.2], [-0.2, 0.2]]) * stiffness,
        nonlinear_force=lambda q, v, tau, p: [p.cubic * q[0] ** 3, p.cubic * (q[1] - q[0]) ** 3],
        forcing=lambda tau, p: [p.force * (0.2 + ca.cos(tau)), 0.0],
        lag_state=np.array([[-0.4, 0.3], [0.0, -2.0]]) / u.time,
        lag_input=np.array([[1.0, 0.0], [0.3, -0.5]]) * u.lag * u.time / u.length,
        lag_output=np.array([[0.02, -0.01], [0.0, 0.02]]) * u.force / u.lag,
        parameters={"force": 0.2 * u.sizes["force"], "cubic": 0.1 * u.sizes["cubic"]},
    )


SYSTEMS = {"duffing": (duffing, 5, (0.5, 1.6)), "two masses with lag states": (with_lags, 3, (0.6, 2.2))}
EXTREME = [
    Units(length=1e-9),
    Units(length=1e9),
    Units(time=1e-9),
    Units(time=1e9),
    Units(mass=1e-9),
    Units(mass=1e9),
    Units(lag=1e9),
    Units(1e-9, 1e9, 1e-9, 1e-9),
    Units(1e9, 1e9, 1e-9, 1e-9),
    Units(1e9, 1e-9, 1e9, 1e9),
    Units(1e-9, 1e-9, 1e9, 1e9),
    Units(3e-7, 7e4, 2e-3, 5.0),
]
SEVERAL = EXTREME[-5:]
OLD = Units()
REFERENCES = {}


def problem_of(name, u):
    build, n_harmonics, _ = SYSTEMS[name]
    return hbnlp.HarmonicBalance(build(u), n_harmonics)


def traced(name, u):
    low, high = (omega / u.time for omega in SYSTEMS[name][2])
    return hbnlp.trace(problem_of(name, u), "omega", (low, high))


def reference(name):
    if name not in REFERENCES:
        REFERENCES[name] = traced(name, OLD)
    return REFERENCES[name]


def same(new, old, size, rtol=1e-9):
    old = np.asarray(old)
    np.testing.assert_allclose(np.asarray(new) / size, old, rtol=0.0, atol=rtol * np.abs(old).max())


def assert_same_branch(name, u):
    """Assert that the two branches are one curve with the same special points.

    Where on it their points lie is not compared: a step's length hangs on whether an error is below a bound, which
    round-off may decide.
    """
    old, new = reference(name), traced(name, u)
    check_branch(new)
    assert (new.end, len(new.special_points)) == (old.end, len(old.special_points))
    for value in np.linspace(*old.span, 9)[1:-1]:
        there = new.at(value / u.time)
        assert len(there) == len(old.at(value))
        for one, other in zip(there, old.at(value), strict=True):
            same(one.coefficients, other.coefficients, u.length)
            same(hbnlp.floquet(one).multipliers, hbnlp.floquet(other).multipliers, 1.0, rtol=1e-7)
    for one, other in zip(new.special_points, old.special_points, strict=True):
        assert (one.kind, one.refined) == (other.kind, other.refined)
        same(one.value, other.value, 1.0 / u.time)
        same(one.solution.coefficients, other.solution.coefficients, u.length)
        for parameter, slope in (other.sensitivity or {}).items():
            same(one.sensitivity[parameter] * u.sizes[parameter], slope, 1.0 / u.time, rtol=1e-7)
    return new


@pytest.mark.parametrize("u", EXTREME)
@pytest.mark.parametrize("name", SYSTEMS)
def test_branch_folds_sensitivities_and_peaks(name, u):
    new, old = assert_same_branch(name, u), reference(name)
    output = old.output_names[0]
    for one, other in zip(hbnlp.peaks(new, output), hbnlp.peaks(old, output), strict=True):
        same(one.value, other.value, 1.0 / u.time, rtol=1e-7)
        same(one.solution.coefficients, other.solution.coefficients, u.length, rtol=1e-6)


factor = st.floats(-9.0, 9.0).map(lambda x: 10.0**x)


@settings(max_examples=8, deadline=None, derandomize=True)
@given(st.builds(Units, factor, factor, factor, factor), st.sampled_from(sorted(SYSTEMS)))
def test_branches_in_random_units(u, name):
    assert_same_branch(name, u)


def off_polygon(points, corners):
    """Return how far each point is from the polygon through the corners."""
    start, side = corners[:-1], np.diff(corners, axis=0)
    along = np.einsum("ijk,jk->ij", points[:, None] - start, side) / np.einsum("jk,jk->j", side, side)
    nearest = start + np.clip(along, 0.0, 1.0)[:, :, None] * side
    return np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1)


@pytest.mark.parametrize("u", SEVERAL)
def test_curves_of_folds(u):
    curves = []
    for units in (OLD, u):
        fold = traced("duffing", units).folds[0]
        span = tuple(force * units.force for force in (0.05, 0.3))
        limits = (0.5 / units.time, 2.5 / units.time)
        curves.append(hbnlp.follow(fold, "force", span=span, limits=limits))
        if units is OLD:
            fine = hbnlp.follow(fold, "force", span=span, limits=limits, method=hbnlp.PseudoArclength(max_step=0.02))
    old, new = curves
    assert (new.ends, [event.kind for event in new.events]) == (old.ends, [event.kind for event in old.events])
    for i in (0, -1):  # where the points between lie hangs on the lengths of steps
        same(new.first[i], old.first[i], 1.0 / u.time)
        same(new.second[i], old.second[i], u.force)
        same(new.coefficients[i], old.coefficients[i], u.length, rtol=1e-7)
    apart = off_polygon(np.c_[new.first * u.time, new.second / u.force], np.c_[fine.first, fine.second])
    assert apart.max() < 1e-5
    for one, other in zip(new.events, old.events, strict=True):
        same((one.first * u.time, one.second / u.force), (other.first, other.second), 1.0)


@pytest.mark.parametrize("u", SEVERAL)
def test_folds_as_programs(u):
    fold = reference("duffing").folds[0]
    problem = problem_of("duffing", u)
    values = problem.values({"omega": fold.value / u.time})
    found = fold_by_program(
        problem, fold.solution.coefficients.ravel() * u.length, values, "omega", hbnlp.Ipopt(), maximum=True
    )
    assert found.converged
    same(found.value, fold.value, 1.0 / u.time)


METHODS = [
    hbnlp.Newton(),
    hbnlp.Ipopt(),
    *(hbnlp.Rootfinder(plugin=name) for name in ("newton", "fast_newton", "kinsol")),
]


@pytest.mark.parametrize("u", SEVERAL)
@pytest.mark.parametrize("method", METHODS, ids=lambda method: getattr(method, "plugin", type(method).__name__))
def test_solutions_by_every_method(method, u):
    exact = hbnlp.solve(problem_of("two masses with lag states", OLD), at={"omega": 0.7})
    problem = problem_of("two masses with lag states", u)
    found = hbnlp.solve(problem, at={"omega": 0.7 / u.time}, method=method)
    same(found.coefficients, exact.coefficients, u.length)


@pytest.mark.parametrize("u", SEVERAL)
@pytest.mark.parametrize("limit", ["above", "below zero"])
def test_designs_keep_their_bounds(u, limit):
    """The largest force at which the amplitude is within a half: its program has bounds in all units."""
    problem = problem_of("duffing", u)
    variables = design.Variables({"force": (0.05 * u.force, 0.5 * u.force)})
    response = design.response_at(problem, variables, hbnlp.solve(problem, at={"omega": 0.9 / u.time}))
    amplitude, half = ca.sqrt(response(problem.amplitude_squared("x"))), 0.5 * u.length
    bound = (-np.inf, amplitude, half) if limit == "above" else (-np.inf, amplitude - half, 0.0)
    program = design.Program(
        variables, [response], objective=-variables["force"] / u.force, bounds={"amplitude": bound}
    )
    found = program.solve({"force": 0.18 * u.force})
    same(np.abs(found.solutions[0].harmonics("x")[1]), 0.5, u.length, rtol=1e-7)
    same(found.values["force"], 0.1067818293, u.force, rtol=1e-9)
    slope = 0.25029577  # of the force by the amplitude, from differences of solutions
    same(found.multipliers["amplitude"] * u.length, [slope], 1.0, rtol=1e-7)


@pytest.mark.parametrize("u", SEVERAL)
@pytest.mark.parametrize(
    "method", [hbnlp.Adaptive(), hbnlp.Adaptive(stiff=True), hbnlp.RungeKutta4()], ids=["Adams", "BDF", "Runge-Kutta"]
)
def test_integrals(method, u):
    old, new = (hbnlp.integrate(with_lags(units), at={"omega": 0.7 / units.time}, method=method) for units in (OLD, u))
    name = next(iter(with_lags(u).output_names))
    assert new.periodic
    same(new.harmonics(name)[:3], old.harmonics(name)[:3], u.length, rtol=1e-6)
