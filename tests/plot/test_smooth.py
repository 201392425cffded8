"""Lines between traced points: against motions solved for there, at folds, corners and special points."""

import dataclasses

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.following import follow
from hbnlp.branches.tracing import trace
from hbnlp.core.kinds import Kind
from hbnlp.diagrams.exploring import explore
from hbnlp.plot.smooth import PARTS, Line
from hbnlp.systems import duffing
from hbnlp.systems.system import System


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def branch():
    return trace(HarmonicBalance(duffing(), 5), "omega", (0.5, 1.6))


@pytest.fixture(scope="module")
def coarse(branch):
    """The branch with every second of its points, and its folds."""
    kept = np.union1d(np.arange(0, len(branch), 2), len(branch) - 1)
    columns = ("parameter", "coefficients", "amplitudes", "n_harmonics", "stable")
    points = [dataclasses.replace(p, index=int(np.searchsorted(kept, p.index, "right")) - 1) for p in branch.folds]
    return dataclasses.replace(
        branch, special_points=tuple(points), **{name: getattr(branch, name)[kept] for name in columns}
    )


@pytest.fixture(scope="module")
def between(branch):
    """Motions solved for between the points of the branch, some near its folds: omega and amplitude."""
    near = [p.value + s * d for p, s in zip(branch.folds, (-1.0, 1.0), strict=True) for d in (1e-4, 1e-3, 5e-3)]
    omegas = [*np.linspace(0.501, 1.4, 30), *near]
    motions = [motion for omega in omegas for motion in branch.at(float(omega))]
    return np.array([[motion.omega, abs(motion.harmonics("x")[1])] for motion in motions])


def distance(points, line):
    """The largest distance of points from a polygon, relative to its extent; both (n, 2)."""
    scale = np.ptp(line, axis=0)
    points, line = points / scale, line / scale
    chords = np.diff(line, axis=0)
    squares = np.maximum(np.sum(chords**2, axis=1), 1e-300)
    farthest = 0.0
    for point in points:
        part = np.clip(np.sum((point - line[:-1]) * chords, axis=1) / squares, 0.0, 1.0)
        farthest = max(farthest, np.linalg.norm(line[:-1] + part[:, None] * chords - point, axis=1).min())
    return farthest


def drawn(ax):
    """All curves of an axes one after another, (n, 2)."""
    curves = [line.get_xydata() for line in ax.get_lines() if len(line.get_xdata()) > 1 and line.get_marker() == "None"]
    return np.concatenate(curves)


def test_motions_between_the_points_of_a_coarse_branch_lie_on_what_is_drawn(coarse, between):
    polygon = np.column_stack([coarse.parameter, abs(coarse.harmonics("x")[:, 1])])
    assert distance(between, polygon) > 5e-3
    stable, unstable, above = (
        line.get_xydata() for line in coarse.plot("x", special=False).get_lines() if len(line.get_xdata()) > 1
    )
    assert distance(between, np.concatenate([stable, unstable, above])) < 5e-4


def test_nothing_is_drawn_beyond_a_fold_and_stability_changes_there(coarse):
    ax = coarse.plot("x", special=False)
    first, middle, last = (line.get_xydata() for line in ax.get_lines() if len(line.get_xdata()) > 1)
    down, up = coarse.folds
    assert first[-1, 0] == middle[0, 0] == down.value == max(first[:, 0].max(), middle[:, 0].max())
    assert last[0, 0] == middle[-1, 0] == up.value == min(last[:, 0].min(), middle[:, 0].min())


def test_the_cubics_are_of_fourth_order():
    def error(n):
        t = np.linspace(0.0, 2.0, n)
        t += 0.2 * np.sin(3.0 * t)
        curve = np.column_stack([np.cos(t), np.sin(t)])
        inner = Line(curve, np.zeros((n, 1, 1)))(curve)[2 * PARTS : -2 * PARTS]
        return np.abs(np.hypot(*inner.T) - 1.0).max()

    assert error(161) < error(81) / 14.0 < error(41) / 150.0


def test_a_corner_stays_and_does_not_bulge():
    x = np.array([0.0, 1.0, 2.0, 3.0, 3.0, 3.0, 3.0])
    y = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0])
    line = Line(np.column_stack([x, y]), np.zeros((7, 1, 1)))
    np.testing.assert_allclose(line(x)[3 * PARTS :], 3.0, rtol=1e-15)
    np.testing.assert_allclose(line(y)[: 3 * PARTS + 1], 0.0, atol=1e-15)


def test_points_that_coincide_and_single_ones_are_drawn_where_they_are():
    x = np.array([0.0, 1.0, 1.0, 2.0])
    fine = Line(x[:, None], np.zeros((4, 1, 1)))(x)
    np.testing.assert_allclose(fine[::PARTS], x)
    assert np.all(np.diff(fine) >= 0.0)
    for few in (x[:0], x[:1]):
        np.testing.assert_array_equal(Line(few[:, None], np.zeros((len(few), 1, 1)))(few), few)


def test_a_fold_curve_goes_through_its_cusp_and_stays_on_one_side_of_it():
    branch = trace(HarmonicBalance(duffing(), 3), "omega", (0.5, 1.6), stability=None)
    curve = follow(branch.folds[0], "force")
    (cusp,) = curve.cusps
    ax = curve.plot()
    first, second = ax.get_lines()[0].get_data()
    assert second.min() == cusp.second
    assert cusp.second in second[first == cusp.first]


def pumped():
    return System(
        1.0,
        0.12,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [0.4 * ca.cos(tau) * q[0] + q[0] ** 3],
        forcing=lambda tau, p: [0.3 * ca.cos(tau)],
    )


def test_a_diagram_draws_one_frequency_and_branches_from_the_point_where_they_begin():
    diagram = explore(HarmonicBalance(pumped(), 3), "omega", (1.5, 4.0))
    base, doubled = diagram.branches
    assert (base.periods, doubled.periods) == (1, 2)
    point = diagram.junctions[diagram.origins[1].junction].point
    assert point.kind is Kind.PERIOD_DOUBLING
    ax = diagram.plot("x", special=False)
    begins = {tuple(line.get_xydata()[0]) for line in ax.get_lines() if len(line.get_xdata()) > 1}
    amplitude = abs(point.solution.harmonics("x")[1])
    assert any(np.allclose(begin, (point.value, amplitude), rtol=1e-12) for begin in begins)
    inner = drawn(ax)
    for omega, amplitude in zip(doubled.parameter, abs(doubled.harmonics("x")[:, 2]), strict=True):
        assert np.abs(inner - [omega, amplitude]).sum(axis=1).min() < 1e-12
    assert doubled.plot("x").get_ylabel() == "|x| (harmonic 1/2)"
