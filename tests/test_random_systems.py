"""Random oscillators held to what must be true of each, and the checks themselves held to finding what is wrong.

A seed that fails runs alone by ``python benchmarks/random_systems.py --count 1 --seed SEED``.
"""

import dataclasses

import invariants
import numpy as np
import pytest
from random_oscillators import TERMS, RandomOscillator
from sampled_balance import SampledBalance

import hbnlp

FOLDED = 6
QUICK = [
    0,
    1,
    5,
    6,
    11,
    12,
    14,
    16,
    17,
    18,
    19,
    22,
    23,
    25,
    26,
    27,
    30,
    31,
    34,
    35,
    37,
    38,
    39,
    40,
    42,
    47,
    53,
    54,
    55,
    56,
    57,
    58,
    59,
    61,
    62,
    64,
    65,
    67,
    68,
    69,
    70,
    257,
    454,
    516,
    555,
    906,
    1049,
]
"""Seeds that take about a second.

At 54 and 29 the steps of Newton's method overflow on the way to the first point, at 68, 257 and 906 pairs of
multipliers meet, at 516 and 555 samples of the force rise at the first point and on the way, at 454 to more than 8192;
at 1049 a motion is so small that steps might be longer than a tongue.
"""


@pytest.mark.parametrize("seed", QUICK)
def test_a_random_system_holds_to_the_invariants(seed):
    oscillator = RandomOscillator.of(seed)
    assert invariants.examine(oscillator).failures == [], oscillator


@pytest.mark.parametrize("seed", [1, 5, 6, 11, 12, 14, 16, 18, 19, 22, 25, 27])
def test_a_random_system_is_traced_to_a_tolerance_every_way_alike(seed):
    oscillator = RandomOscillator.of(seed)
    assert invariants.examine_to_a_tolerance(oscillator, 1e-4).failures == [], oscillator


def test_the_quick_seeds_have_every_kind_of_term():
    oscillators = [RandomOscillator.of(seed) for seed in QUICK]
    assert {name for oscillator in oscillators for name in oscillator.names} == set(TERMS)
    assert any(len(oscillator.lags[0]) for oscillator in oscillators)
    assert any(oscillator.load[0].any() for oscillator in oscillators)  # preload
    assert any(oscillator.load[2].any() for oscillator in oscillators)  # second harmonic
    assert any(not oscillator.load[1].any() for oscillator in oscillators)  # zero forcing
    assert any(oscillator.units != (1.0, 1.0, 1.0) for oscillator in oscillators)


def test_a_seed_is_one_system():
    one, other = (SampledBalance(RandomOscillator.of(5)) for _ in range(2))
    x = np.random.default_rng(0).standard_normal(one.n * one.m)
    np.testing.assert_array_equal(one.residual(x, 1.1), other.residual(x, 1.1))


@pytest.mark.parametrize("seed", QUICK[:4])
def test_the_derivative_by_complex_steps_is_that_by_differences(seed):
    balance = SampledBalance(RandomOscillator.of(seed))
    length, time, force = balance.oscillator.units
    x, w, h = length * np.random.default_rng(seed).standard_normal(balance.n * balance.m), 1.1 / time, 1e-6 * length
    steps = h * np.eye(x.size)
    columns = [(balance.residual(x + step, w) - balance.residual(x - step, w)) / (2.0 * h) for step in steps]
    np.testing.assert_allclose(
        balance.jacobian(x, w) * length / force, np.array(columns).T * length / force, rtol=1e-6, atol=1e-6
    )


@pytest.fixture(scope="module")
def bent():
    """A system whose branch has folds."""
    oscillator = RandomOscillator.of(FOLDED)
    problem = oscillator.problem()
    return oscillator, problem, hbnlp.trace(problem, "omega", oscillator.span)


def failures(check, oscillator, problem, branch):
    report = invariants.Report()
    check(report, oscillator, problem, branch)
    assert report.checks
    return report.failures


def test_a_wrong_residual_is_found(bent):
    oscillator, problem, branch = bent
    off = dataclasses.replace(branch, coefficients=branch.coefficients * (1.0 + 1e-5))
    assert failures(invariants.check_residual, oscillator, problem, off)


def test_a_wrong_fold_is_found(bent):
    oscillator, problem, branch = bent
    assert branch.folds
    moved = [dataclasses.replace(fold, value=fold.value * (1.0 + 1e-5)) for fold in branch.folds]
    off = dataclasses.replace(branch, special_points=tuple(moved))
    assert failures(invariants.check_folds, oscillator, problem, off)


def test_wrong_multipliers_are_found(bent):
    oscillator, problem, branch = bent
    off = dataclasses.replace(branch, multipliers=branch.multipliers * 1.01)
    assert failures(invariants.check_multipliers, oscillator, problem, off)


def test_a_special_point_that_is_missing_is_found(bent):
    oscillator, problem, branch = bent
    off = dataclasses.replace(branch, special_points=branch.special_points[1:])
    assert failures(invariants.check_reversed, oscillator, problem, off)


def test_a_branch_that_is_run_through_twice_is_found(bent):
    oscillator, problem, branch = bent
    keep = np.arange(len(branch)) % 2 == 0
    there = np.concatenate([np.flatnonzero(keep), np.flatnonzero(~keep)[::-1]])
    twice = dataclasses.replace(branch, coefficients=branch.coefficients[there], parameter=branch.parameter[there])
    assert failures(invariants.check_retraced, oscillator, problem, twice)


@pytest.mark.filterwarnings("ignore::hbnlp.LinearInstabilityWarning")
def test_a_point_that_is_not_located_does_not_end_the_trace():
    """At seed 68 two multipliers meet within the step of a Neimark-Sacker: Brent's method needs over sixty steps."""
    oscillator = RandomOscillator.of(68)
    branch = hbnlp.trace(oscillator.problem(), "omega", oscillator.span)
    assert branch.complete
