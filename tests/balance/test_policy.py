"""One policy decides how often force, excitation and outputs are sampled; balances that differ in it are built once."""

import dataclasses
import gc
import sys
import weakref
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

from hbnlp.balance.problem import MOST_RELATIVES, HarmonicBalance
from hbnlp.balance.sampling import ALIASING_TOL, MOST_SAMPLES, Sampling
from hbnlp.solutions.solving import solve
from hbnlp.systems import chain, duffing
from hbnlp.systems.spectrum import Spectrum
from hbnlp.systems.system import System


def pendulum():
    return System(
        1.0,
        0.2,
        0.0,
        nonlinear_force=lambda q, v, tau, p: [ca.sin(q[0]) + 0.1 * v[0] ** 3],
        forcing=lambda tau, p: [p.load * ca.cos(tau)],
        parameters={"load": 0.5, "omega": 0.7},
    )


# -- the policy --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("n_harmonics", "periods", "given", "force", "outputs"),
    [
        (1, 1, None, 5, 9),
        (7, 1, None, 29, 57),
        (7, 2, None, 29, 57),
        (7, 2, 100, 100, 100),
        (3, 5, 7, 7, 25),
    ],
)
def test_the_numbers_of_samples_of_a_cubic_force(n_harmonics, periods, given, force, outputs):
    sampling = Sampling.of(duffing(), n_harmonics, periods, given)
    linear = Spectrum(degree=1, highest=0)
    assert (sampling.force.n_samples, sampling.outputs(linear).n_samples) == (force, outputs)
    assert sampling.settled
    assert sampling.automatic is (given is None)


def test_a_policy_cannot_be_changed_from_outside():
    problem = HarmonicBalance(duffing(), 3)
    with pytest.raises(dataclasses.FrozenInstanceError):
        problem.sampling.n_samples = 5
    with pytest.raises(AttributeError):
        problem.samples_are_settled = False
    with pytest.raises(AttributeError):
        problem.n_samples = 5


def test_samples_of_an_unknown_force_are_doubled_and_stay_with_other_harmonics():
    start = Sampling.of(pendulum(), 3)
    assert (start.n_samples, start.settled, start.degree) == (25, False, None)
    twice = start.doubled()
    assert (twice.n_samples, twice.settled, twice.automatic) == (50, False, False)
    assert twice.with_harmonics(6).n_samples == 50  # what the force takes depends on its steepness, and is checked
    assert twice.with_harmonics(9).n_samples == Sampling.of(pendulum(), 9).n_samples
    assert twice.with_harmonics(1).n_samples == 50
    assert start.with_harmonics(6) == Sampling.of(pendulum(), 6)


def test_a_number_given_stays_the_users_word_with_other_harmonics():
    given = Sampling.of(duffing(), 3, n_samples=10)
    assert given.with_harmonics(6).settled
    assert given.with_harmonics(6).n_samples == 25  # exact for H = 6, and more than in proportion
    assert given.with_harmonics(3).n_samples == 13


def test_doubling_ends():
    sampling = Sampling.of(pendulum(), 3, n_samples=MOST_SAMPLES // 2)
    with pytest.raises(ValueError, match="not smooth enough"):
        sampling.doubled().doubled()


@pytest.mark.parametrize("value", [0, -1, 2.5])
def test_other_harmonics_are_whole_and_positive(value):
    with pytest.raises(ValueError, match=f"n_harmonics is {value!r}; give an integer from 1"):
        HarmonicBalance(duffing(), 3).with_harmonics(value)


def test_samples_suffice_where_twice_as_many_leave_the_residual():
    problem = HarmonicBalance(pendulum(), 3)
    values = problem.values()
    for size, enough in ((0.1, True), (30.0, False)):
        x = size * np.eye(problem.size)[1]
        moved = np.abs(problem.oversampled().assembly.residual(x, values) - problem.assembly.residual(x, values)).max()
        assert (moved <= ALIASING_TOL * problem.assembly.term_size(x, values)) == enough
        assert problem.samples_suffice(x, values) is enough
    assert HarmonicBalance(pendulum(), 3, n_samples=25).samples_suffice(x, values)


@pytest.mark.parametrize(("width", "least"), [(1e-1, 100), (1e-2, 1000), (1e-3, 8193)])
def test_a_steep_force_takes_the_samples_that_it_needs(width, least):
    """Of tanh(v / width) harmonic k falls as exp(-k width / speed): 10 to 20 speed / width samples, speed 1.1."""
    system = System(
        1.0,
        0.1,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [0.2 * ca.tanh(v[0] / width)],
        forcing=lambda tau, p: [ca.cos(tau)],
    )
    solution = solve(HarmonicBalance(system, 3), at={"omega": 1.5})
    assert least <= solution.problem.n_samples <= 2 * least
    dense = HarmonicBalance(system, 3, n_samples=2**17)
    x, values = solution.coefficients.ravel(), dense.values({"omega": 1.5})
    assert np.abs(dense.assembly.residual(x, values)).max() <= 1e-9 * dense.assembly.term_size(x, values)


# -- relatives ---------------------------------------------------------------------------------------------------------


def test_the_balance_with_other_harmonics_is_built_once_and_leads_back():
    problem = HarmonicBalance(duffing(), 5)
    three = problem.with_harmonics(3)
    assert problem.with_harmonics(3) is three
    assert three.x is three.x
    assert three.with_harmonics(5) is problem is problem.with_harmonics(5)
    assert problem.with_harmonics(7).with_harmonics(3) is three
    fresh = HarmonicBalance(problem.system, 3)
    x, values = np.linspace(-1.0, 1.0, fresh.size), fresh.values({"omega": 1.1})
    np.testing.assert_array_equal(three.assembly.residual(x, values), fresh.assembly.residual(x, values))


def test_twice_the_samples_are_built_once():
    problem = HarmonicBalance(pendulum(), 3)
    assert problem.oversampled() is problem.oversampled()
    assert problem.oversampled().oversampled().n_samples == 4 * problem.n_samples


def test_relatives_do_not_pile_up_and_go_with_their_last_user():
    problem = HarmonicBalance(duffing(), 1)
    for n_harmonics in range(1, 3 * MOST_RELATIVES):
        problem.with_harmonics(n_harmonics)
    assert len(problem._relatives) == MOST_RELATIVES
    child, origin = problem.with_harmonics(70), weakref.ref(problem)
    gc.disable()
    try:
        del problem
        assert origin() is None
    finally:
        gc.enable()
    assert child.with_harmonics(3) is child.with_harmonics(3)


# -- threads -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("system", [pendulum(), chain(3)], ids=["pendulum", "chain"])
def test_threads_that_share_a_balance_get_its_numbers(system):
    problem = HarmonicBalance(system, 4)
    rng = np.random.default_rng(3)
    points = [(rng.normal(size=problem.size), problem.values({"omega": w})) for w in rng.uniform(0.5, 2.0, 40)]

    def numbers(point):
        x, values = point
        assembly, omega = problem.assembly, problem.system.parameters.index("omega")
        return np.concatenate(
            [
                assembly.residual(x, values),
                assembly.jacobian(x, values).ravel(),
                assembly.parameter_derivative(x, values, omega),
                assembly.jacobian_along(x, values, x[::-1].copy(), omega).ravel(),
            ]
        )

    expected = [numbers(point) for point in points]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)  # threads take turns as often as they can
    try:
        with ThreadPoolExecutor(4) as pool:
            found = list(pool.map(numbers, points * 10))
    finally:
        sys.setswitchinterval(interval)
    for result, alone in zip(found, expected * 10, strict=True):
        np.testing.assert_array_equal(result, alone)


def test_an_interrupt_half_way_leaves_nothing_that_looks_whole(monkeypatch):
    problem = HarmonicBalance(chain(2), 3)
    assembly, x = problem.assembly, np.linspace(-1.0, 1.0, problem.size)
    here, there = problem.values({"omega": 1.0}), problem.values({"omega": 1.0, "force": 0.7})
    expected = assembly.residual(x, there)
    assembly.residual(x, here)

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(assembly.linear._compiled, "at", interrupted)
        with pytest.raises(KeyboardInterrupt):
            assembly.residual(x, there)
    np.testing.assert_array_equal(assembly.residual(x, there), expected)
