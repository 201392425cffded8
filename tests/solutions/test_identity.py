"""When two solutions are one motion, images of motions, and which symmetries a motion has."""

import dataclasses

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.fourier import resize, shift, stretch
from hbnlp.solutions.identity import moved, relation, same_motion, without_turns
from hbnlp.solutions.solution import make_solution
from hbnlp.solutions.solving import solve
from hbnlp.systems import duffing
from hbnlp.systems.symmetry import Symmetry
from hbnlp.systems.system import System

SWAP = Symmetry([[0, 1], [1, 0]], name="swap")
HALF = Symmetry(-np.eye(2), shift=np.pi, name="half-period sign change")


def pair(n_harmonics=5, periods=1, **options):
    """Two equal Duffing oscillators on a spring, the loads in phase."""
    system = System(
        np.eye(2),
        0.1 * np.eye(2),
        [[1.2, -0.2], [-0.2, 1.2]],
        nonlinear_force=lambda q, v, tau, p: q**3,
        forcing=lambda tau, p: [p.force * ca.cos(tau), p.force * p.share * ca.cos(tau)],
        parameters={"force": 0.3, "share": 1.0},
        outputs={"x1": lambda s: s.q[0], "x2": lambda s: s.q[1], "power": lambda s: s.q[0] * s.v[1]},
        symmetries=[SWAP],
        **options,
    )
    return HarmonicBalance(system, n_harmonics, periods=periods)


PAIR, TWICE = pair(), pair(4, 2)
UNITS = st.floats(-1.0, 1.0, allow_nan=False)


def some(problem, numbers):
    """Any motion, a solution or not, of a problem."""
    x = np.resize(np.asarray(numbers), problem.size) * (1.0 + np.arange(problem.size) % 7)
    return make_solution(problem, x, problem.values({"omega": 1.1}))


motions = st.lists(UNITS, min_size=5, max_size=30).map(lambda numbers: some(PAIR, [*numbers, 1.0]))
long_motions = st.lists(UNITS, min_size=5, max_size=30).map(lambda numbers: some(TWICE, [*numbers, 1.0]))
symmetries = st.sampled_from(PAIR.system.symmetries_at())


def residual(solution):
    problem = solution.problem
    return problem.assembly.residual(solution.coefficients.ravel(), problem.values(solution.parameters))


# -- properties --------------------------------------------------------------------------------------------------------


@settings(max_examples=30, deadline=None)
@given(motions, symmetries)
def test_the_image_of_the_image_is_the_motion(motion, symmetry):
    again = motion.image(symmetry).image(symmetry)
    np.testing.assert_allclose(again.coefficients, motion.coefficients, atol=1e-12)
    np.testing.assert_allclose(again.amplitudes, motion.amplitudes, atol=1e-9)
    assert same_motion(again, motion)


@settings(max_examples=30, deadline=None)
@given(motions, symmetries)
def test_the_residual_of_an_image_is_that_of_the_motion(motion, symmetry):
    image, terms = residual(motion.image(symmetry)), residual(motion)
    assert np.linalg.norm(image) == pytest.approx(np.linalg.norm(terms), rel=1e-10)
    rows = moved(terms.reshape(PAIR.shape), symmetry, 1)  # the mass matrix is the identity: equations move alike
    np.testing.assert_allclose(image.reshape(PAIR.shape), rows, atol=1e-9 * np.abs(terms).max())


@settings(max_examples=30, deadline=None)
@given(motions, symmetries)
def test_an_image_is_what_the_symmetry_says_at_every_time(motion, symmetry):
    t = np.linspace(0.0, 5.0, 7)
    then = symmetry.matrix @ motion.displacement(t + symmetry.shift / motion.omega)
    np.testing.assert_allclose(motion.image(symmetry).displacement(t), then, atol=1e-10)
    assert relation(motion, motion.image(symmetry)) is not None


@settings(max_examples=30, deadline=None)
@given(long_motions, st.integers(-3, 3))
def test_a_motion_of_two_periods_is_one_wherever_it_begins(motion, later):
    shifted = dataclasses.replace(motion, coefficients=shift(motion.coefficients, np.pi * later))
    back = dataclasses.replace(shifted, coefficients=shift(shifted.coefficients, -np.pi * later))
    np.testing.assert_allclose(back.coefficients, motion.coefficients, atol=1e-12)
    assert same_motion(motion, shifted)
    assert relation(motion, shifted).is_identity


@settings(max_examples=30, deadline=None)
@given(motions, st.integers(1, 3), st.integers(5, 9))
def test_periods_and_harmonics_are_those_that_both_have(motion, factor, n_harmonics):
    coefficients = stretch(resize(motion.coefficients, n_harmonics), factor)
    longer = dataclasses.replace(motion, coefficients=coefficients, periods=factor, problem=None)
    assert same_motion(motion, longer)
    assert same_motion(longer, motion)
    assert relation(longer, motion).is_identity


# -- solutions ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def in_phase():
    return solve(PAIR, at={"omega": 1.1})


def test_the_motion_in_phase_has_all_symmetries_and_odd_harmonics(in_phase):
    assert [each.name for each in in_phase.symmetries] == [each.name for each in PAIR.system.symmetries_at()]
    assert in_phase.is_odd
    assert np.abs(in_phase.harmonics("x1")[::2]).max() < 1e-12
    assert in_phase.image(SWAP).statistics["start"] == "image by swap"


def test_outputs_of_an_image_are_recomputed():
    other = some(PAIR, [0.3, -0.2, 0.5, 0.1])
    image = other.image(SWAP)
    np.testing.assert_allclose(image.harmonics("x1"), other.harmonics("x2"), atol=1e-14)
    exact = PAIR.output_harmonics(image.coefficients.ravel(), PAIR.values(image.parameters))[0]
    np.testing.assert_array_equal(image.amplitudes, exact)
    assert np.abs(image.harmonics("power") - other.harmonics("power")).max() > 0.1


def test_another_load_leaves_no_swap():
    uneven = solve(PAIR, at={"omega": 1.1, "share": 0.9})
    assert [each.name for each in uneven.symmetries] == ["half-period sign change"]
    with pytest.raises(
        ValueError, match=r"does not have the symmetry 'swap': the load .* at force = 0\.3, share = 0\.9"
    ):
        uneven.image(SWAP)


def test_static_load_leaves_no_odd_motion():
    system = System(
        1.0, 0.1, 1.0, nonlinear_force=lambda q, v, tau, p: [q[0] ** 2], forcing=lambda tau, p: [ca.cos(tau)]
    )
    solution = solve(HarmonicBalance(system, 3), at={"omega": 3.0})
    assert solution.is_odd is False
    assert solution.symmetries == ()


def test_other_parameters_or_degrees_of_freedom_are_other_motions(in_phase):
    near = solve(PAIR, at={"omega": 1.1 * (1 + 1e-7)})
    assert not same_motion(in_phase, near)
    assert relation(in_phase, near) is None
    assert same_motion(in_phase, dataclasses.replace(near, parameters=in_phase.parameters))
    single = solve(HarmonicBalance(duffing(), 5), at={"omega": 1.1})
    assert not same_motion(in_phase, single)


def test_solutions_without_a_problem_are_compared_without_symmetries():
    motion = some(PAIR, [0.3, -0.2, 0.5, 0.1])
    image = motion.image(SWAP)
    filed, filed_image = (dataclasses.replace(each, problem=None) for each in (motion, image))
    assert relation(motion, image) == SWAP
    assert relation(motion, filed_image) == SWAP
    assert relation(filed, image) == SWAP
    assert relation(filed, filed_image) is None
    assert relation(filed, motion).is_identity
    assert filed.is_odd is None
    for ask in (lambda: filed.symmetries, lambda: filed.image(SWAP)):
        with pytest.raises(ValueError, match="a solution from a file has no problem"):
            ask()


def test_a_tolerance_lets_truncation_pass():
    coarse, fine = (solve(HarmonicBalance(duffing(force=1.0), n), at={"omega": 0.6}) for n in (3, 9))
    assert not same_motion(coarse, fine)
    assert same_motion(coarse, fine, tol=1e-2)
    for tol in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match=f"tol is {tol}; give a finite number greater than 0"):
            same_motion(coarse, fine, tol=tol)


def test_turns_of_angles_by_two_pi_are_one_motion():
    def standing(**options):
        system = System(
            1.0,
            0.1,
            0.0,
            nonlinear_force=lambda q, v, tau, p: [ca.sin(q[0])],
            forcing=lambda tau, p: [0.2 * ca.cos(tau)],
            **options,
        )
        problem = HarmonicBalance(system, 3)
        return [solve(problem, at={"omega": 2.0}, start=[[mean, *[0.0] * 6]]) for mean in (np.pi, -np.pi, 7 * np.pi)]

    assert all(same_motion(a, b) for a in standing(angles=["x"]) for b in standing(angles=[0]))
    up, down, far = standing()
    assert not same_motion(up, far)
    assert relation(up, down).name == "half-period sign change"
    assert standing(angles=["x"])[0].is_odd  # about pi, and -pi is the same angle
    assert not up.is_odd


@given(st.floats(-50.0, 50.0))
def test_means_of_angles_lie_in_one_turn(mean):
    turned = without_turns(np.array([[mean, 0.2, 0.1], [mean, 0.0, 0.0]]), (0,))
    assert -np.pi < turned[0, 0] <= np.pi + 1e-5
    assert np.cos(turned[0, 0]) == pytest.approx(np.cos(mean), abs=1e-12)
    np.testing.assert_array_equal(turned[1], [mean, 0.0, 0.0])
