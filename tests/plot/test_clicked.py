"""Clicks on a branch show the motion there: events as a window sends them, on a canvas without one."""

import contextlib

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.backend_bases import KeyEvent, MouseEvent

import hbnlp
from hbnlp.plot import plot_clicked


@pytest.fixture(scope="module")
def branch():
    return hbnlp.trace(hbnlp.HarmonicBalance(hbnlp.systems.duffing(), 3), "omega", (0.6, 1.5))


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")


def click(ax, x, y, dx=0.0):
    """Send a click at a place in the units of the axes, and so many pixels beside it."""
    ax.figure.canvas.draw()
    across, up = ax.transData.transform((x, y))
    event = MouseEvent("button_press_event", ax.figure.canvas, across + dx, up, 1)
    event.canvas.callbacks.process(event.name, event)


def press(ax, key):
    event = KeyEvent("key_press_event", ax.figure.canvas, key)
    event.canvas.callbacks.process(event.name, event)


def place(branch, index):
    return branch.parameter[index], abs(branch.harmonics("x")[index, 1])


def test_a_click_shows_the_motion_at_the_nearest_point_also_where_three_share_a_frequency(branch):
    shown = []
    clicked = plot_clicked(branch, "x", draw=lambda solution, ax: shown.append((solution, ax)))
    for index in (5, int(branch.folds[0].index) - 2, len(branch) - 3):
        click(clicked.axes, *place(branch, index), dx=1.0)
        solution, ax = shown[-1]
        assert clicked.index == index
        assert np.array_equal(solution.coefficients, branch.solution(index).coefficients)
        assert f"omega = {branch.parameter[index]:.6g}" in ax.get_title()
        assert ax.get_title().endswith(", stable" if branch.stable[index] else ", unstable")
        marker = clicked.axes.lines[-1]
        assert np.allclose([marker.get_xdata()[0], marker.get_ydata()[0]], place(branch, index))
        assert np.array_equal(clicked.solution.coefficients, solution.coefficients)
    assert len(shown) == 3


def test_the_phase_portrait_is_what_is_shown_of_a_system_that_is_no_wing(branch):
    clicked = plot_clicked(branch, "x")
    click(clicked.axes, *place(branch, 10))
    panel = clicked.axes.figure.figure.axes[-1]
    assert panel.get_ylabel().startswith("rate of")


def test_arrow_keys_go_along_the_branch_and_stop_at_its_ends(branch):
    clicked = plot_clicked(branch, "x", draw=lambda solution, ax: None)
    press(clicked.axes, "right")
    assert clicked.index is None
    clicked.show(1)
    for key, index in (("left", 0), ("left", 0), ("right", 1), ("q", 1)):
        press(clicked.axes, key)
        assert clicked.index == index


def test_clicks_far_away_and_clicks_while_zooming_are_none(branch):
    clicked = plot_clicked(branch, "x", draw=lambda solution, ax: None)
    click(clicked.axes, 0.65, 2.4)
    assert clicked.index is None
    waiting = {"_wait_cursor_for_draw_cm": lambda self: contextlib.nullcontext()}  # what drawing asks of one
    clicked.axes.figure.canvas.toolbar = type("Toolbar", (), {"mode": "zoom rect", **waiting})()
    click(clicked.axes, *place(branch, 10))
    assert clicked.index is None
    clicked.axes.figure.canvas.toolbar = None
    click(clicked.axes, *place(branch, 10))
    assert clicked.index == 10
    clicked.disconnect()
    click(clicked.axes, *place(branch, 20))
    assert clicked.index == 10


def test_a_branch_that_is_drawn_already_is_clicked_there_and_stays_as_it_is(branch):
    ax = branch.plot("x", decibels=True)
    ax.set_xscale("log")
    ax.figure.canvas.draw()
    limits = ax.get_xlim(), ax.get_ylim()
    clicked = plot_clicked(branch, "x", ax=ax, decibels=True)
    frequency, size = place(branch, 12)
    click(ax, frequency, 20.0 * np.log10(size))
    assert clicked.index == 12
    assert len(plt.get_fignums()) == 2
    assert (ax.get_xlim(), ax.get_ylim()) == limits


def test_the_shape_of_a_wing_is_drawn_with_one_bar_each_time():
    wing = hbnlp.membrane_wing(
        hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.008, n_modes=2),
        hbnlp.aero.thin_airfoil(2),
        parameters={"pitch_amplitude": 0.01},
    )
    branch = hbnlp.trace(hbnlp.HarmonicBalance(wing, 1), "omega", (0.5, 1.0), stability=None)
    clicked = plot_clicked(branch, "C_L")
    clicked.show(0)
    clicked.show(1)
    figure = clicked.axes.figure.figure
    assert len(figure.axes) == 3
    assert plt.get_fignums() == [figure.number]
    assert figure.axes[1].get_xlabel() == "$x/c$"
