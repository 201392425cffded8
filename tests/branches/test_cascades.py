"""Cascades of period doublings, switch after switch by default options, against shooting by direct integration."""

import logging

import casadi as ca
import numpy as np
import pytest
from independent import FirstOrder, multipliers, state

import hbnlp
from hbnlp.fourier import stretch
from hbnlp.testing import check_branch

FEIGENBAUM, FEIGENBAUM_WITHOUT_DAMPING = 4.6692, 8.7211
"""Limits of the ratios of successive distances: M. J. Feigenbaum, J. Stat. Phys. 19 (1978), doi:10.1007/BF01020332;
J. M. Greene, R. S. MacKay, F. Vivaldi and M. J. Feigenbaum, Physica D 3 (1981)."""


def double_well(damping, length=1.0):
    """x'' + d x' - x + x^3 = f cos w t, with x in units of a length."""
    return hbnlp.System(
        1.0,
        damping,
        -1.0,
        nonlinear_force=lambda q, v, tau, p: [q[0] ** 3 / length**2],
        forcing=lambda tau, p: [length * p.force * ca.cos(tau)],
        parameters={"omega": 1.0, "force": 0.1},
    )


def escape(damping):
    """x'' + d x' + x - x^2 = f cos w t, softening to one side."""
    return hbnlp.System(
        1.0,
        damping,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [-(q[0] ** 2)],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"omega": 0.85, "force": 0.01},
    )


def pendulum():
    """x'' + .2 x' + (1 + f cos w t) sin x = 0, whose support moves up and down."""
    return hbnlp.System(
        1.0,
        0.2,
        0.0,
        nonlinear_force=lambda q, v, tau, p: [(1.0 + p.force * ca.cos(tau)) * ca.sin(q[0])],
        parameters={"omega": 2.0, "force": 0.2},
    )


def first_crossing(subject, span):
    """Trace until another branch crosses, by default options."""
    tracer = hbnlp.Tracer(subject, "force", span)
    for traced in tracer:
        for point in traced.special_points:
            if point.kind.code in ("PD", "BP"):
                check_branch(tracer.branch())
                return point
    raise AssertionError(f"nothing crosses: {tracer.branch()}")


def cascade(subject, span, depth, side=0):
    """The points at which the motion loses its stability to the next one, in order."""
    points = [first_crossing(subject, span)]
    while len(points) < depth:
        points.append(first_crossing(hbnlp.switch_branch(points[-1])[side], span))
    return points


def in_a_well(system, n_harmonics, force, length=1.0):
    problem = hbnlp.HarmonicBalance(system, n_harmonics)
    start = np.zeros((1, 2 * n_harmonics + 1))
    start[0, 0] = length
    return hbnlp.solve(problem, at={"force": force}, start=start)


def critical(point):
    """The multiplier nearest to -1 of the true motion near the point, whose periods are the first to repeat it."""
    motion = point.solution
    first_order = FirstOrder(motion.problem.system, motion.parameters)
    _, matrix = first_order.periodic(state(motion), motion.periods)
    values = multipliers(matrix)
    return values[np.argmin(np.abs(values + 1.0))]


def ratios(points):
    steps = np.diff([point.value for point in points])
    return steps[:-1] / steps[1:]


@pytest.fixture(scope="module")
def wells():
    with pytest.warns(hbnlp.LinearInstabilityWarning):
        return cascade(in_a_well(double_well(0.25), 12, 0.1), (0.1, 0.6), 5)


def test_a_double_well_doubles_its_period_five_times_by_default_options(wells):
    assert [point.kind.code for point in wells] == ["PD"] * 5
    assert [point.solution.periods for point in wells] == [1, 2, 4, 8, 16]
    np.testing.assert_allclose(ratios(wells), FEIGENBAUM, rtol=0.02)


def test_each_doubling_of_the_cascade_is_one_of_the_true_motion(wells):
    for point in wells[:4]:
        assert critical(point) == pytest.approx(-1.0, abs=1e-5)


def test_the_motion_that_a_switch_leads_to_is_stable_and_has_lost_no_doubling_on_the_way(wells):
    for point in wells[:3]:
        for start in hbnlp.switch_branch(point):
            first_order = FirstOrder(start.problem.system, start.parameters)
            _, matrix = first_order.periodic(state(start), start.periods)
            values = multipliers(matrix)
            assert np.all(np.abs(values) < 1.0)
            assert values[0].real > 0.4


@pytest.mark.parametrize("length", [1e-9, 1e9])
def test_a_cascade_is_the_same_in_other_units(wells, length):
    with pytest.warns(hbnlp.LinearInstabilityWarning):
        points = cascade(in_a_well(double_well(0.25, length), 12, 0.1, length), (0.1, 0.6), 4, side=1)
    np.testing.assert_allclose([p.value for p in points], [p.value for p in wells[:4]], rtol=1e-9)


def test_without_much_damping_doublings_crowd_as_those_of_maps_that_keep_areas():
    points = cascade(hbnlp.HarmonicBalance(escape(0.01), 12), (0.002, 0.2), 4)
    assert [point.solution.periods for point in points] == [1, 2, 4, 8]
    np.testing.assert_allclose(ratios(points), FEIGENBAUM_WITHOUT_DAMPING, rtol=0.1)
    for point in points[:3]:
        assert critical(point) == pytest.approx(-1.0, abs=1e-5)


def test_a_cascade_is_followed_down_as_well_from_where_a_symmetry_is_broken():
    with pytest.warns(hbnlp.LinearInstabilityWarning):
        points = cascade(hbnlp.HarmonicBalance(double_well(0.25), 16), (3.0, 0.3), 5)
    assert [point.kind.code for point in points] == ["BP", "PD", "PD", "PD", "PD"]
    for point in points[1:4]:
        assert critical(point) == pytest.approx(-1.0, abs=1e-4)


def test_a_pendulum_goes_from_rest_through_a_doubling_a_broken_symmetry_and_a_cascade():
    points = cascade(hbnlp.HarmonicBalance(pendulum(), 8), (0.2, 3.0), 5)
    assert [point.kind.code for point in points] == ["PD", "BP", "PD", "PD", "PD"]
    assert [point.solution.periods for point in points] == [1, 2, 2, 4, 8]
    for point in points[2:4]:
        assert critical(point) == pytest.approx(-1.0, abs=1e-4)


def test_with_few_harmonics_a_switch_leaves_from_where_the_balance_has_the_doubling():
    """Ten harmonics put the doublings 3e-4 off, more than the distance between the last two."""
    with pytest.warns(hbnlp.LinearInstabilityWarning):
        points = cascade(hbnlp.HarmonicBalance(double_well(0.25), 10), (3.0, 0.3), 6)
    assert [point.solution.periods for point in points] == [1, 1, 2, 4, 8, 16]
    np.testing.assert_allclose(points[-1].value, 2.80094, rtol=3e-4)  # with 14 and with 20 harmonics
    start = hbnlp.switch_branch(points[3])[0]
    problem, origin = start.problem, start.origin
    jacobian = problem.assembly.jacobian(stretch(origin.coefficients, 2).ravel(), problem.values(origin.parameters))
    sizes = np.linalg.svd(jacobian, compute_uv=False)
    assert sizes[-1] < 1e-8 * sizes[0]
    assert abs(origin.parameters["force"] / points[3].value - 1.0) > 1e-5


def test_a_switch_that_cannot_be_made_near_enough_says_so(wells, monkeypatch, caplog):
    monkeypatch.setattr("hbnlp.branches.departing.MOVED", 0.0)
    with caplog.at_level(logging.WARNING):
        one, other = hbnlp.switch_branch(wells[0])
    assert one.parameters["force"] == pytest.approx(0.1818, abs=1e-4)
    assert other.parameters["force"] == pytest.approx(one.parameters["force"], rel=1e-9)
    assert "with more harmonics it can be entered nearer" in caplog.text
