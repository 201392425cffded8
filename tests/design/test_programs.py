"""Programs over responses: against retraced folds and closed forms."""

import dataclasses

import casadi as ca
import numpy as np
import pytest

import hbnlp
from hbnlp.design import Program, Variables, fold_at, response_at

ZETA, CUBIC, FORCE = 0.025, 0.1, 0.18


@pytest.fixture(scope="module")
def problem():
    return hbnlp.HarmonicBalance(hbnlp.systems.duffing(damping_ratio=ZETA, cubic=CUBIC, force=FORCE), n_harmonics=3)


@pytest.fixture(scope="module")
def branch(problem):
    return hbnlp.trace(problem, "omega", (0.7, 1.6), stability=None)


def force_for(amplitude, omega, cubic):
    """Force of one harmonic's response: F^2 = A^2 ((1 + 3/4 g A^2 - w^2)^2 + (2 z w)^2)."""
    return amplitude * np.hypot(1.0 + 0.75 * cubic * amplitude**2 - omega**2, 2.0 * ZETA * omega)


# -- folds as constraints ----------------------------------------------------------------------------------------------


def test_a_fold_is_moved_to_the_frequency_asked_for(problem, branch):
    _, up = branch.folds
    shared = Variables({"cubic": (0.01, 1.0)})
    fold = fold_at(problem, shared, up, "omega")
    bounds = {"first fold": (1.2, fold.symbol("omega"), np.inf)}
    optimum = Program(shared, [fold], objective=shared["cubic"], bounds=bounds).solve({"cubic": CUBIC})
    retraced = hbnlp.trace(problem, "omega", (0.7, 2.0), at=optimum.values, stability=None)
    first = retraced.folds[-1]
    assert abs(first.value - 1.2) < 1e-8
    assert abs(optimum.solutions[0].omega - 1.2) < 1e-8
    assert np.allclose(optimum.solutions[0].coefficients, first.solution.coefficients, atol=1e-6)
    # the multiplier is minus the derivative of the objective by the limit, that is one over the fold's sensitivity
    assert optimum.multipliers["first fold"][0] == pytest.approx(-1.0 / first.sensitivity["cubic"], rel=1e-6)


def test_two_folds_share_two_variables(problem, branch):
    shared = Variables({"damping_ratio": (0.01, 0.1), "force": (0.05, 0.5)})
    down, up = (fold_at(problem, shared, fold, "omega") for fold in branch.folds)
    bounds = {
        "up": (1.15, up.symbol("omega"), 1.15),
        "down": (1.25, down.symbol("omega"), 1.25),
    }
    program = Program(shared, [down, up], objective=shared["force"], bounds=bounds)
    optimum = program.solve({"damping_ratio": ZETA, "force": FORCE})
    retraced = hbnlp.trace(problem, "omega", (0.7, 2.0), at=optimum.values, stability=None)
    assert np.allclose([fold.value for fold in retraced.folds], [1.25, 1.15], atol=1e-8)


def test_a_bound_that_cannot_be_met_is_named_and_the_stopping_point_is_kept(problem, branch):
    shared = Variables({"cubic": (0.01, 0.2)})
    fold = fold_at(problem, shared, branch.folds[1], "omega")
    bounds = {"first fold": (1.5, fold.symbol("omega"), np.inf)}
    program = Program(shared, [fold], objective=shared["cubic"], bounds=bounds)
    with pytest.raises(hbnlp.ConvergenceError, match=r"'first fold'.*relax") as caught:
        program.solve({"cubic": CUBIC})
    assert not caught.value.result.converged
    assert not program.solve({"cubic": CUBIC}, throw=False).converged


# -- several load points -----------------------------------------------------------------------------------------------


def test_load_points_share_a_variable_and_the_tighter_one_is_active():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(damping_ratio=ZETA, cubic=CUBIC, force=0.1), n_harmonics=1)
    shared = Variables({"force": (0.01, 1.0)})
    slow, fast = (response_at(problem, shared, hbnlp.solve(problem, at={"omega": omega})) for omega in (0.6, 1.5))
    size = ca.sqrt(problem.amplitude_squared("x"))
    bounds = {"slow": (0.0, slow(size), 0.5), "fast": (0.0, fast(size), 0.5)}
    optimum = Program(shared, [slow, fast], objective=-shared["force"], bounds=bounds).solve({"force": 0.1})
    forces = [force_for(0.5, omega, CUBIC) for omega in (0.6, 1.5)]
    assert optimum.values["force"] == pytest.approx(min(forces), rel=1e-8)
    assert optimum.multipliers["slow"][0] > 1e-3
    assert abs(optimum.multipliers["fast"][0]) < 1e-6
    assert [s.omega for s in optimum.solutions] == [0.6, 1.5]
    for solution in optimum.solutions:
        again = hbnlp.solve(problem, at=solution.parameters, start=solution)
        assert np.allclose(again.coefficients, solution.coefficients, atol=1e-9)


def test_a_program_is_solved_again_with_other_data_and_from_an_earlier_optimum():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(damping_ratio=ZETA, cubic=CUBIC, force=0.1), n_harmonics=1)
    shared = Variables({"force": (0.01, 1.0)})
    point = response_at(problem, shared, hbnlp.solve(problem, at={"omega": 0.6}))
    largest = ca.MX.sym("largest")
    bounds = {"amplitude": (-np.inf, point(ca.sqrt(problem.amplitude_squared("x"))) - largest, 0.0)}
    program = Program(shared, [point], objective=-shared["force"], bounds=bounds, data=largest)
    first = program.solve({"force": 0.1}, data=0.4)
    second = program.solve(first, data=0.7)
    for optimum, amplitude in ((first, 0.4), (second, 0.7)):
        assert optimum.values["force"] == pytest.approx(force_for(amplitude, 0.6, CUBIC), rel=1e-8)


@pytest.mark.parametrize("expand", [True, False])
def test_a_wing_is_designed_at_its_fold(expand):
    membrane = hbnlp.QuasiLinearMembrane(prestrain=0.008, n_modes=2)
    pitch = {"pitch_amplitude": np.radians(0.5)}
    wing = hbnlp.membrane_wing(membrane, hbnlp.aero.thin_airfoil(n_modes=2), parameters=pitch)
    problem = hbnlp.HarmonicBalance(wing, n_harmonics=1)
    branch = hbnlp.trace(problem, "omega", (1.0, 6.0), stability=None)
    shared = Variables({"prestrain": (0.004, 0.02)})
    fold = fold_at(problem, shared, branch.folds[1], "omega")
    program = Program(
        shared,
        [fold],
        objective=shared["prestrain"] / 0.008,
        bounds={"first fold": (4.2, fold.symbol("omega"), np.inf)},
        expand=expand,
    )
    optimum = program.solve({"prestrain": 0.008})
    retraced = hbnlp.trace(problem, "omega", (1.0, 7.0), at=optimum.values, stability=None)
    assert abs(min(f.value for f in retraced.folds) - 4.2) < 1e-8


# -- bad input ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bounds", [(1.0, 1.0), (2.0, 1.0), (0.0, np.inf), (np.nan, 1.0)])
def test_bounds_of_variables_must_be_finite_and_rising(bounds):
    with pytest.raises(ValueError, match=r"bounds\['cubic'\]"):
        Variables({"cubic": bounds})


def test_what_is_no_fold_or_no_parameter_is_refused(problem, branch):
    shared, fold = Variables({"cubic": (0.01, 1.0)}), branch.folds[0]
    with pytest.raises(ValueError, match="refined fold"):
        fold_at(problem, shared, dataclasses.replace(fold, kind=hbnlp.Kind.PEAK), "omega")
    with pytest.raises(ValueError, match="cannot be a variable"):
        fold_at(problem, Variables({"omega": (1.0, 2.0)}), fold, "omega")
    with pytest.raises(KeyError, match="did you mean 'cubic'"):
        response_at(problem, Variables({"cubc": (0.1, 1.0)}), branch.solution(0))
    with pytest.raises(KeyError, match="did you mean 'cubic'"):
        shared["cubi"]


def test_a_program_says_what_is_missing(problem, branch):
    shared, other = Variables({"cubic": (0.01, 1.0)}), Variables({"cubic": (0.01, 1.0)})
    point = response_at(problem, shared, branch.solution(0))
    with pytest.raises(ValueError, match="same Variables"):
        Program(other, [point], objective=other["cubic"])
    with pytest.raises(ValueError, match=r"response\(expression\)"):
        Program(shared, [point], objective=problem.amplitude_squared("x"))
    with pytest.raises(ValueError, match="nothing lies in between"):
        Program(shared, [point], objective=shared["cubic"], bounds={"empty": (1.0, shared["cubic"], 0.0)})
    with pytest.raises(ValueError, match="responses is empty"):
        Program(shared, [], objective=shared["cubic"])
    program = Program(shared, [point], objective=shared["cubic"])
    with pytest.raises(KeyError, match="start lacks 'cubic'"):
        program.solve({})
    with pytest.raises(ValueError, match="data has shape"):
        program.solve({"cubic": 0.1}, data=[1.0])


def test_a_problem_with_a_tolerance_is_refused_with_the_number_to_give(problem):
    """A program has one number of harmonics: it cannot be raised while variables move."""
    tolerant = hbnlp.HarmonicBalance(problem.system, tolerance=1e-6)
    fold = hbnlp.trace(tolerant, "omega", (0.7, 1.6), stability=None).folds[0]
    shared = Variables({"cubic": (0.01, 1.0)})
    given = rf"has tolerance = 1e-06, but .* HarmonicBalance\(system, n_harmonics={fold.n_harmonics}\)"
    for refused in (tolerant, fold.problem):
        with pytest.raises(ValueError, match=given):
            response_at(refused, shared, fold.solution)
        with pytest.raises(ValueError, match=given):
            fold_at(refused, shared, fold, "omega")
        with pytest.raises(ValueError, match=given):
            hbnlp.identification.Identification(shared, refused, [({"omega": 1.1}, fold.solution)], "x")
    fixed = hbnlp.HarmonicBalance(problem.system, n_harmonics=fold.n_harmonics)
    assert fold_at(fixed, shared, fold, "omega").problem is fixed


def test_only_what_users_need_is_shown():
    for name in hbnlp.design.__all__:
        assert getattr(hbnlp.design, name).__module__.startswith("hbnlp.design.")


def test_an_optimum_on_whose_motion_the_force_has_a_corner_says_so_and_is_kept():
    gap = hbnlp.System(
        [[1.0]], [[0.2]], [[1.0]], nonlinear_force=lambda q, v, tau, p: [3.0 * ca.fmax(q[0] - 0.5, 0.0)],
        forcing=lambda tau, p: [p.force * ca.cos(tau)], parameters={"force": 1.0},
    )  # fmt: skip
    known = hbnlp.solve(hbnlp.HarmonicBalance(gap, 3, n_samples=512), at={"omega": 0.7})
    sampled = hbnlp.HarmonicBalance(gap, 3)
    while not sampled.sampling.doubles_to_many:
        sampled = sampled.oversampled()
    shared = Variables({"force": (0.9, 1.1)})
    program = Program(shared, [response_at(sampled, shared, known)], objective=shared["force"])
    optimum = program.solve({"force": 1.0}, throw=False)
    assert not optimum.converged
    assert "at the optimum, nonlinear_force[0] has a corner on this motion" in optimum.message
    assert optimum.values["force"] == pytest.approx(0.9)
