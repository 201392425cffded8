"""Neimark-Sacker points are the same whichever way a branch is traced: at rest in closed form, and where pairs meet."""

import casadi as ca
import numpy as np
import pytest
from random_oscillators import RandomOscillator

import hbnlp
from hbnlp.branches.forecast import Spectrum, _distance_of_zero, hidden_crossing
from hbnlp.testing import check_branch

pytestmark = pytest.mark.filterwarnings("ignore::hbnlp.LinearInstabilityWarning")
BOTH_WAYS = pytest.mark.parametrize("backwards", [False, True], ids=["up", "down"])


def along_rest(backwards, span, **system):
    """Trace the rest of a system in mu."""
    made = hbnlp.System(parameters={"mu": span[0], "omega": system.pop("omega", 1.0)}, **system)
    problem = hbnlp.HarmonicBalance(made, 1)
    branch = hbnlp.trace(problem, "mu", span[::-1] if backwards else span, start=np.zeros(problem.shape))
    check_branch(branch)
    return branch


@BOTH_WAYS
@pytest.mark.parametrize("meeting", [0.97, 1.03])
def test_a_pair_crosses_in_a_step_in_which_two_real_multipliers_meet(meeting, backwards):
    """q1'' - q1' + (1/4 + mu - meeting) q1 is critically damped there, q2'' + (1 - mu) q2' + 2 q2 has a centre at 1."""
    branch = along_rest(
        backwards,
        (0.9, 1.5),
        mass=np.eye(2),
        damping=lambda p: ca.diag(ca.vertcat(-1.0, 1.0 - p.mu)),
        stiffness=lambda p: ca.diag(ca.vertcat(0.25 + p.mu - meeting, 2.0)),
        nonlinear_force=lambda q, v, tau, p: q**3,
    )
    (point,) = branch.special_points
    assert point.kind.code == "NS"
    assert point.refined
    assert point.value == pytest.approx(1.0, abs=1e-9)
    assert point.multiplier.imag == pytest.approx(abs(np.sin(2.0 * np.pi * np.sqrt(2.0))), abs=1e-8)


@BOTH_WAYS
def test_a_pair_that_comes_in_is_told_beside_a_doubling(backwards):
    """x'' + .3 (mu - 1) x' + (1.05 + (mu - .9) cos 2 t) x: the product of both is 1 at mu = 1 (Liouville)."""
    branch = along_rest(
        backwards,
        (0.8, 1.6),
        omega=2.0,
        mass=1.0,
        damping=lambda p: 0.3 * (p.mu - 1.0),
        stiffness=1.05,
        nonlinear_force=lambda q, v, tau, p: [(p.mu - 0.9) * ca.cos(tau) * q[0] + q[0] ** 3],
    )
    (doubling,), (point,) = branch.of_kind("PD"), branch.of_kind("NS")
    assert len(branch.special_points) == 2
    assert point.value == pytest.approx(1.0, abs=1e-8)
    assert doubling.value == pytest.approx(1.000637713983, abs=1e-9)


@BOTH_WAYS
def test_two_real_multipliers_whose_product_passes_one_are_no_neimark_sacker(backwards):
    """q1'' + (mu - 1.04) q1' + (1 - mu) q1: a pair becomes real, one passes +1 at mu = 1; the product is 1 at 1.04."""
    branch = along_rest(
        backwards,
        (0.8, 1.5),
        mass=np.eye(2),
        damping=lambda p: ca.diag(ca.vertcat(p.mu - 1.04, 0.1)),
        stiffness=lambda p: ca.diag(ca.vertcat(1.0 - p.mu, 0.04)),
        nonlinear_force=lambda q, v, tau, p: q**3,
    )
    (point,) = branch.special_points
    assert point.kind.code == "BP"
    assert point.value == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("damping", [1e-10, 0.0])
def test_a_pair_that_begins_on_the_circle_but_for_the_tolerance_leaves_it_there(damping):
    """q'' - (mu + damping) q' + 2 q: the moduli are 1 + 3e-10 at the first point, which counts as not beyond one."""
    branch = along_rest(
        False,
        (0.0, 0.5),
        mass=1.0,
        damping=lambda p: -(p.mu + damping),
        stiffness=2.0,
        nonlinear_force=lambda q, v, tau, p: q**3,
    )
    (point,) = branch.special_points
    assert point.kind.code == "NS"
    assert point.refined
    assert point.value == pytest.approx(0.0, abs=1e-6)


@BOTH_WAYS
@pytest.mark.parametrize("centre", [0.21, 0.3, 0.33, 0.4, 0.47])
def test_a_shallow_passage_through_the_circle_is_found_where_it_is(centre, backwards):
    """q'' + c (w^2 - (mu - centre)^2) q' + 2 q: |multiplier| - 1 is -5e-6 at the centre; a step may end within 1e-6."""
    width = 0.04
    branch = along_rest(
        backwards,
        (0.0, 0.6),
        mass=1.0,
        damping=lambda p: 1e-3 * (width**2 - (p.mu - centre) ** 2),
        stiffness=2.0,
        nonlinear_force=lambda q, v, tau, p: q**3,
    )
    values = sorted(point.value for point in branch.special_points)
    np.testing.assert_allclose(values, [centre - width, centre + width], atol=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_tongues_of_two_oscillators_pumped_at_the_sum_of_their_frequencies_are_found(seed):
    """They leave the circle within +-2 sqrt(k^2 - g^2 / 4) of the sum, k = depth / (4 sqrt(w1 w2)), by averaging."""
    rng = np.random.default_rng(seed)
    width, pumping = 10.0 ** rng.uniform(-3.5, -1.5), rng.uniform(1.2, 3.0)
    first, second = rng.uniform(0.5, 0.9), rng.uniform(1.2, 1.9)
    damping = 0.5 * width * (first + second) / np.sqrt(pumping**2 - 1.0)
    depth = 2.0 * pumping * damping * np.sqrt(first * second)
    system = hbnlp.System(
        np.eye(2),
        damping * np.eye(2),
        np.diag([first**2, second**2]),
        nonlinear_force=lambda q, v, tau, p: [depth * ca.cos(tau) * q[1 - i] + q[i] ** 3 for i in range(2)],
    )
    span = np.array([0.87, 1.13]) * (first + second)
    branch = hbnlp.trace(hbnlp.HarmonicBalance(system, 1), "omega", tuple(span[:: rng.choice([-1, 1])]))
    assert [point.kind.code for point in branch.special_points] == ["NS", "NS"]
    found = np.ptp([point.value for point in branch.special_points]) / (first + second)
    assert found == pytest.approx(width, rel=0.05)


def test_a_wide_tongue_in_one_long_step_is_found_both_ways():
    """Of nine points; beside a multiplier of 100 the product over all pairs shows no dip."""
    oscillator = RandomOscillator.of(257)
    problem = oscillator.problem()
    there = hbnlp.trace(problem, "omega", oscillator.span)
    back = hbnlp.trace(there.solution(len(there) - 1), "omega", oscillator.span[::-1])
    values = [sorted(point.value for point in branch.of_kind("NS")) for branch in (there, back)]
    assert len(values[0]) == 2
    np.testing.assert_allclose(values[0], values[1], rtol=1e-8)


# -- the forecast ------------------------------------------------------------------------------------------------------


def meeting(place, *, coupling, decays=(0.1, 0.2), speed=0.9, other=100.0):
    """Multipliers of two pairs that meet at angle 2 at place 0, and a large real one."""
    mean, half = -0.5 * sum(decays), 0.5 * (decays[1] - decays[0]) + 1j * speed * place
    exponents = mean + 0.2j * place + np.array([1.0, -1.0]) * np.sqrt(half**2 + coupling**2 + 0j)
    upper = np.exp(exponents + 2.0j)
    return np.array([other * np.exp(3.0 * place), *upper, *upper.conj()])


@pytest.mark.parametrize("share", [0.2, 0.5, 0.7])
@pytest.mark.parametrize("coupling", [0.16, 0.175, 0.19])
def test_pairs_that_leave_the_circle_where_they_meet_are_forecast(coupling, share):
    places = 0.8 * (np.array([-1.0, 0.0, 1.0]) - share)
    spectra = [Spectrum(place, meeting(place, coupling=coupling)) for place in places]
    looks = []

    def look(place):
        looks.append(place)
        return meeting(place, coupling=coupling)

    place = hidden_crossing(*spectra, look, 1e-6)
    assert np.sort(np.abs(meeting(place, coupling=coupling)))[-3] > 1.0
    assert len(looks) <= 3


@pytest.mark.parametrize("share", [0.35, 0.5, 0.65])
@pytest.mark.parametrize("depth", [1e-5, 1e-4])
def test_a_pair_that_comes_inside_where_it_meets_another_is_forecast(depth, share):
    """One pair is outside by about 0.001 before and after, and inside by the depth at the meeting."""
    outside, inner = 0.001, 0.117
    half = 0.5 * (inner + outside)
    coupling = 1j * np.sqrt(half**2 - (0.5 * (inner - outside) - depth) ** 2)
    places = 0.1 * (np.array([-1.0, 0.0, 1.0]) - share)
    spectra, looks = [], []

    def at(place):
        return meeting(place, coupling=coupling, decays=(-outside, inner), other=0.5)

    def look(place):
        looks.append(place)
        return at(place)

    spectra = [Spectrum(place, at(place)) for place in places]
    assert all(np.abs(spectrum.multipliers).max() > 1.0 for spectrum in spectra)
    place = hidden_crossing(*spectra, look, 1e-6)
    assert place is not None
    assert np.abs(at(place)).max() < 1.0
    assert len(looks) <= 3


@pytest.mark.parametrize("coupling", [0.0, 0.08])
def test_pairs_that_pass_one_another_inside_are_hardly_looked_at(coupling):
    looks = []

    def look(place):
        looks.append(place)
        return meeting(place, coupling=coupling)

    spectra = [Spectrum(place, meeting(place, coupling=coupling)) for place in (-1.4, -0.4, 0.6)]
    assert hidden_crossing(*spectra, look, 1e-6) is None
    assert len(looks) <= 4


def test_two_pairs_that_leave_one_after_another_hide_nothing():
    def at(place):
        upper = np.exp(np.array([0.05 + 0.2 * place + 1.0j, -0.05 + 0.2 * place + 2.0j]))
        return np.array([*upper, *upper.conj()])

    looks = []
    spectra = [Spectrum(place, at(place)) for place in (-2.0, -1.0, 1.0)]
    assert hidden_crossing(*spectra, looks.append, 1e-6) is None
    assert looks == []


@pytest.mark.parametrize("multipliers", [[np.inf] * 4, [], [1e-4, 1e-5], [100.0, 50.0], [0.5 - 0.5j]])
def test_multipliers_that_overflow_or_are_far_from_the_circle_are_not_followed(multipliers):
    spectra = [Spectrum(place, np.array(multipliers, dtype=complex)) for place in (-1.0, 0.0, 1.0)]
    assert hidden_crossing(*spectra, lambda place: None, 1e-6) is None


def test_how_far_the_zeros_of_parabolas_are_from_an_interval():
    places = np.array([0.0, 0.5, 2.0])
    parabolas = {
        lambda t: (t - 0.7) * (t + 9.0): 0.0,
        lambda t: (t - 1.0 - 0.2j) * (t - 7.0): 0.2,
        lambda t: (t - 3.0) * (t + 1.0): 1.0,  # outside on both sides
        lambda t: (t - 2.3 - 0.4j) * (t + 5.0): 0.5,
        lambda t: t - 0.1: 0.4,  # a straight line, before the interval
        lambda t: 1.0 + 0.0 * t: np.inf,
        lambda t: 0.0 * t: 0.0,
    }
    values = np.array([parabola(places.astype(complex)) for parabola in parabolas]).T
    np.testing.assert_allclose(_distance_of_zero(places, values, 0.5), [*parabolas.values()], atol=1e-12)
