"""Drawings: what is in them, where they go, and that nothing is shown unasked."""

import copy
import dataclasses

import casadi as ca
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import same_color

from hbnlp.aero import thin_airfoil
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.extrema import peaks
from hbnlp.branches.following import follow
from hbnlp.branches.tracing import trace
from hbnlp.core.kinds import Kind
from hbnlp.plot import EVENT_MARKERS, MARKERS, plot_branch, plot_fold_curve, plot_sweep
from hbnlp.sweeps.sweeping import sweep
from hbnlp.systems import chain, duffing, tuned_absorber
from hbnlp.systems.system import System
from hbnlp.wing.coupling import membrane_wing
from hbnlp.wing.lift import lift_response
from hbnlp.wing.membrane import QuasiLinearMembrane
from hbnlp.wing.validity import Validity, ValidityLimits


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")


@pytest.fixture(autouse=True)
def _not_shown(monkeypatch):
    def shown(*_, **__):
        pytest.fail("show() was called")

    monkeypatch.setattr(plt, "show", shown)


@pytest.fixture(scope="module")
def branch():
    return trace(HarmonicBalance(duffing(), 5), "omega", (0.5, 1.6))


@pytest.fixture(scope="module")
def absorber():
    return trace(HarmonicBalance(tuned_absorber(force=0.15), 5), "omega", (0.9, 1.4))


def lines(ax, dashed):
    """The curves with data, stable or unstable."""
    solid = [line for line in ax.get_lines() if len(line.get_xdata()) > 1 and line.get_linestyle() != "None"]
    return [line for line in solid if (line.get_linestyle() == "--") == dashed]


def legend(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_tests_draw_without_a_window():
    assert mpl.get_backend().lower() == "agg"


def test_the_whole_branch_is_drawn_stable_thick_and_unstable_thin(branch):
    ax = branch.plot("x")
    assert isinstance(ax, Axes)
    stable, unstable = lines(ax, dashed=False), lines(ax, dashed=True)
    assert len(stable) == 2
    assert len(unstable) == 1
    assert all(line.get_linewidth() > unstable[0].get_linewidth() for line in stable)
    down, up = branch.folds
    drawn = unstable[0].get_xdata()
    assert drawn.max() == down.value
    assert drawn.min() == up.value
    x, y = (
        np.concatenate([getattr(line, get)() for line in (*stable, *unstable)]) for get in ("get_xdata", "get_ydata")
    )
    drawn = set(zip(x, y, strict=True))
    assert drawn >= set(zip(branch.parameter, np.abs(branch.harmonics("x")[:, 1]), strict=True))
    assert len({line.get_color() for line in (*stable, *unstable)}) == 1


def test_successive_parts_meet_without_a_gap(branch):
    ax = branch.plot("x")
    first, second = lines(ax, dashed=False)
    (middle,) = lines(ax, dashed=True)
    ends = [(line.get_xdata()[k], line.get_ydata()[k]) for line in (first, middle, second) for k in (0, -1)]
    assert ends[1] == ends[2]
    assert ends[3] == ends[4]


def test_without_stability_the_branch_is_one_solid_curve_without_such_a_legend():
    plain = trace(HarmonicBalance(duffing(), 3), "omega", (0.5, 1.6), stability=None)
    ax = plain.plot("x")
    assert len(lines(ax, dashed=False)) == 1
    assert lines(ax, dashed=True) == []
    assert legend(ax) == ["fold"]


def test_special_points_are_marked_where_they_are_with_one_legend_entry_a_kind(absorber):
    ax = absorber.plot("x1")
    assert legend(ax) == ["stable", "unstable", "fold", "Neimark-Sacker"]
    for kind in (Kind.FOLD, Kind.NEIMARK_SACKER):
        points = absorber.of_kind(kind)
        marker, color = MARKERS[kind]
        (drawn,) = [e for e in ax.get_lines() if e.get_marker() == marker and len(e.get_xdata()) == len(points)]
        np.testing.assert_array_equal(drawn.get_xdata(), [p.value for p in points])
        sizes = [abs(p.solution.harmonics("x1")[1]) for p in points]
        np.testing.assert_allclose(drawn.get_ydata(), sizes)
        assert same_color(drawn.get_color(), color)
    bare = absorber.plot("x1", special=False)
    assert legend(bare) == ["stable", "unstable"]


@pytest.mark.parametrize("beyond", ["before", "after"])
def test_a_step_over_a_fold_is_shaded_whole_if_one_of_its_ends_is_beyond(branch, beyond):
    index = branch.folds[0].index
    camber = np.zeros(len(branch))
    camber[index if beyond == "before" else index + 1] = 1.0
    found = Validity(
        camber=camber, tension_error=0 * camber, beyond_band=0 * camber, incidence=0 * camber, limits=ValidityLimits()
    )
    (shaded,) = (
        line.get_xydata()
        for line in branch.plot("x", validity=found).lines
        if line.get_linewidth() == 9.0 and len(line.get_xdata())
    )
    first = index - 1 if beyond == "before" else index
    ends = np.column_stack([branch.parameter, abs(branch.harmonics("x")[:, 1])])[[first, first + 2]]
    np.testing.assert_allclose(shaded[[0, -1]], ends, rtol=1e-12)
    assert branch.folds[0].value in shaded[:, 0]


def test_letters_stand_beside_special_points_if_asked_for(branch):
    ax = branch.plot("x", codes=True)
    assert [text.get_text() for text in ax.texts] == ["LP", "LP"]
    assert [text.xy[0] for text in ax.texts] == [p.value for p in branch.folds]
    assert not branch.plot("x").texts


def test_branches_share_axes_and_legend_entries(branch):
    _, ax = plt.subplots()
    other = trace(HarmonicBalance(duffing(force=0.1), 5), "omega", (0.5, 1.6))
    assert branch.plot("x", ax=ax, label="one") is ax
    assert other.plot("x", ax=ax, label="other", color="k") is ax
    assert legend(ax) == ["one", "stable", "unstable", "fold", "other"]
    black = [line for line in lines(ax, dashed=False) if same_color(line.get_color(), "k")]
    assert black
    assert len(plt.get_fignums()) == 1


def test_axes_are_labelled_with_parameter_output_and_harmonic(branch):
    assert branch.plot("x").get_xlabel() == r"$\omega$"
    assert branch.plot("x").get_ylabel() == "|x| (harmonic 1)"
    assert branch.plot("x", harmonic=3).get_ylabel() == "|x| (harmonic 3)"
    assert branch.plot("x", harmonic=0).get_ylabel() == "mean of x"
    assert branch.plot("x", harmonic=0, decibels=True).get_ylabel() == "|mean of x| (dB)"
    assert branch.plot("x", harmonic=0, per="x").get_ylabel() == "mean of x / |x|"
    assert branch.plot("x", decibels=True).get_ylabel() == "|x| (harmonic 1, dB)"
    in_force = trace(HarmonicBalance(duffing(), 3), "force", (0.0, 0.3), at={"omega": 0.9}, stability=None)
    assert in_force.plot("x").get_xlabel() == "force"


def test_axes_have_the_labels_and_units_that_a_system_is_given():
    system = System(
        1.0,
        0.1,
        1.0,
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"force": 1.0, "omega": 0.5},
        labels={"x": "deflection"},
        units={"x": "mm", "omega": "rad/s", "force": "N"},
    )
    problem = HarmonicBalance(copy.deepcopy(system), 1)
    ax = trace(problem, "omega", (0.5, 0.6), stability=None).plot("x")
    assert (ax.get_xlabel(), ax.get_ylabel()) == (r"$\omega$ (rad/s)", "|deflection| (mm, harmonic 1)")
    in_force = trace(problem, "force", (1.0, 2.0), stability=None)
    assert in_force.plot("x").get_xlabel() == "force (N)"
    assert in_force.solution(0).plot("x").get_ylabel() == "deflection (mm)"
    told = in_force.to_xarray()
    assert told.force.attrs["units"] == "N"
    assert told.attrs["units_x"] == "mm"
    with pytest.raises(KeyError, match="unknown parameter or output 'y'"):
        System(1.0, 0.1, 1.0, units={"y": "mm"})
    with pytest.raises(TypeError, match=r"units\['x'\] is 3; give a text"):
        System(1.0, 0.1, 1.0, units={"x": 3})


def test_a_mean_is_drawn_with_its_sign():
    """x'' + .1 x' + x + .2 x^3 = -.5 + F cos tau: about the real root of x^3 + 5 x + 2.5, -.478138."""
    system = System(
        1.0,
        0.1,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [0.2 * q[0] ** 3],
        forcing=lambda tau, p: [-0.5 + p.force * ca.cos(tau)],
        parameters={"force": 1e-3, "omega": 0.5},
    )
    problem, tolerant = HarmonicBalance(system, 3), HarmonicBalance(system, tolerance=1e-6)
    branch = trace(problem, "omega", (0.4, 0.6), stability=None)
    marched = [sweep(problem, "omega", [0.4, 0.5]), sweep(system, "omega", [0.4, 0.5], n_harmonics=3)]
    for record in (branch, *marched, trace(tolerant, "omega", (0.4, 0.6), stability=None)):
        for decibels, level in ((False, -0.478138), (True, 20.0 * np.log10(0.478138))):
            drawn = [line.get_ydata() for line in record.plot("x", harmonic=0, decibels=decibels).get_lines()]
            np.testing.assert_allclose(next(y for y in drawn if len(y)), level, rtol=1e-5)


def test_a_branch_is_coloured_by_its_numbers_of_harmonics_with_a_bar_that_tells_them(tmp_path):
    problem = HarmonicBalance(duffing(damping_ratio=0.05, cubic=1.0, force=0.5), tolerance=1e-4)
    branch = trace(problem, "omega", (0.6, 3.0))
    ax = branch.plot("x", color="n_harmonics")
    (bar,) = (each for each in ax.figure.axes if each is not ax)
    numbers = np.unique(branch.n_harmonics)
    assert len(numbers) > 2
    assert [text.get_text() for text in bar.get_yticklabels()] == [f"{number}" for number in numbers]
    assert bar.get_ylabel() == "number of harmonics"
    colors = {}
    for line in lines(ax, dashed=False) + lines(ax, dashed=True):
        where = np.flatnonzero(np.isin(branch.parameter, line.get_xdata()[:-1]))
        (number,) = {*branch.n_harmonics[where]}  # all but the last point, where the next run begins
        colors.setdefault(number, set()).add(line.get_color())
    assert sorted(colors) == numbers.tolist()
    assert len(set.union(*colors.values())) == len(numbers)
    assert legend(ax) == ["stable", "unstable", "fold"]
    branch.save(tmp_path / "branch.npz")
    again = Branch.load(tmp_path / "branch.npz").plot("x", color="n_harmonics")
    for a, b in zip(ax.get_lines(), again.get_lines(), strict=True):
        np.testing.assert_array_equal(a.get_xydata(), b.get_xydata())
        assert same_color(a.get_color(), b.get_color())


def test_one_number_of_harmonics_is_one_colour(branch):
    ax = branch.plot("x", color="n_harmonics", label="all alike")
    assert [text.get_text() for text in ax.figure.axes[1].get_yticklabels()] == ["5"]
    assert "all alike" in legend(ax)
    with pytest.raises(ValueError, match=r"color is 'harmonics'; give a colour of matplotlib, .* or 'n_harmonics'"):
        branch.plot("x", color="harmonics")


def test_higher_harmonics_and_decibels_are_drawn_as_such(branch):
    third = np.concatenate([line.get_ydata() for line in lines(branch.plot("x", harmonic=3), dashed=False)])
    assert np.isin(np.abs(branch.harmonics("x")[:3, 3]), third).all()
    decibels = np.concatenate([line.get_ydata() for line in lines(branch.plot("x", decibels=True), dashed=False)])
    assert np.isin(20 * np.log10(np.abs(branch.harmonics("x")[:3, 1])), decibels).all()


def test_lift_per_pitching_acceleration_is_drawn_over_the_logarithm_of_frequency():
    wing = membrane_wing(QuasiLinearMembrane(prestrain=0.008, n_modes=2), thin_airfoil(2))
    response = trace(HarmonicBalance(wing, 1), "omega", (0.5, 5.0), at={"pitch_amplitude": 0.01}, stability=None)
    _, ax = plt.subplots()
    ax.set_xscale("log")
    response.plot("C_L", ax=ax, per="alpha_acceleration", decibels=True)
    assert ax.get_xlabel() == r"$\omega c/U$"
    assert ax.get_ylabel() == r"$|C_L|$ / $|\alpha''|$ (harmonic 1, dB)"
    assert response.plot("alpha", harmonic=0).get_ylabel() == r"mean of $\alpha$ (rad)"
    loaded = dataclasses.replace(response, problem=None)
    assert (loaded.plot("C_L").get_xlabel(), loaded.plot("C_L").get_ylabel()) == (r"$\omega$", "|C_L| (harmonic 1)")
    ratio = np.abs(response.harmonics("C_L")[:, 1]) / (0.01 * response.parameter**2)
    (line,) = lines(ax, dashed=False)
    drawn = line.get_ydata()[np.isin(line.get_xdata(), response.parameter)]
    np.testing.assert_allclose(drawn, 20 * np.log10(ratio), rtol=1e-9)


def test_rest_in_decibels_is_no_warning():
    at_rest = trace(HarmonicBalance(duffing(), 3), "force", (0.0, 0.3), at={"omega": 0.9}, stability=None)
    assert np.isneginf(lines(at_rest.plot("x", decibels=True), dashed=False)[0].get_ydata()[0])


def test_peaks_have_a_marker_of_their_own(branch):
    marked = dataclasses.replace(branch, special_points=(*branch.special_points, *peaks(branch, "x")))
    ax = plot_branch(marked, "x")
    assert "peak" in legend(ax)


def test_branch_points_are_marked():
    problem = HarmonicBalance(chain(3), 3)
    symmetric = trace(problem, "omega", (1.25, 1.0), stability=None, at={"force": 0.5})
    ax = symmetric.plot("x3")
    assert (ax.get_legend() is not None and "branch point" in legend(ax)) == bool(symmetric.branch_points)


def test_a_branch_from_a_file_is_drawn_the_same(branch, tmp_path):
    branch.save(tmp_path / "branch.npz")
    one, other = branch.plot("x"), Branch.load(tmp_path / "branch.npz").plot("x")
    for a, b in zip(one.get_lines(), other.get_lines(), strict=True):
        np.testing.assert_array_equal(a.get_xydata(), b.get_xydata())


def test_a_sweep_has_arrows_for_jumps_and_no_line_across_them():
    problem = HarmonicBalance(duffing(), 3)
    marched = sweep(problem, "omega", np.arange(1.2, 1.35, 0.01), start=None)
    down = sweep(problem, "omega", np.arange(1.3, 1.05, -0.01))
    _, ax = plt.subplots()
    assert plot_sweep(down, "x", ax=ax, label="down") is ax
    assert down.plot("x", label="again", ax=ax) is ax
    arrows = [text for text in ax.texts if text.arrow_patch is not None]
    assert len(arrows) == 2
    jump = int(down.jumps[0])
    assert arrows[0].xy == (down.parameter[jump], np.abs(down.harmonics("x")[jump, 1]))
    parts = ax.get_lines()[:2]
    assert [len(part.get_xdata()) for part in parts] == [jump, len(down) - jump]
    assert same_color(parts[0].get_color(), parts[1].get_color())
    assert legend(ax) == ["down", "again"]
    assert [text for text in marched.plot("x").texts if text.arrow_patch] == []


def test_a_time_sweep_is_drawn_as_well():
    marched = sweep(duffing(damping_ratio=0.2), "omega", [0.8, 0.9, 1.0])
    ax = plot_sweep(marched, "x")
    np.testing.assert_allclose(ax.get_lines()[0].get_ydata(), np.abs(marched.harmonics("x")[:, 1]))
    assert marched.plot("x", ax=ax) is ax
    assert len(ax.get_lines()) == 2


def test_a_sweep_without_arrows_has_gaps_where_it_jumps():
    problem = HarmonicBalance(duffing(), 3)
    marched = sweep(problem, "omega", np.linspace(1.3, 0.8, 26))
    assert len(marched.jumps)
    ax = marched.plot("x", jumps=False)
    assert not ax.texts
    assert len(ax.get_lines()) == 1 + len(marched.jumps)
    assert len(marched.plot("x").texts) == len(marched.jumps)


def test_a_fold_curve_is_drawn_in_its_plane_with_its_events(branch):
    curve = follow(branch.folds[0], "force")
    ax = curve.plot()
    assert (ax.get_xlabel(), ax.get_ylabel()) == (r"$\omega$", "force")
    assert legend(ax) == ["folds", "cusp"]
    (event,) = curve.cusps
    drawn = set(zip(ax.get_lines()[0].get_xdata(), ax.get_lines()[0].get_ydata(), strict=True))
    assert drawn >= {*zip(curve.first, curve.second, strict=True), (event.first, event.second)}
    drawn = [line for line in ax.get_lines() if line.get_marker() == EVENT_MARKERS[event.kind][0]]
    assert (drawn[0].get_xdata()[0], drawn[0].get_ydata()[0]) == (event.first, event.second)
    _, given = plt.subplots()
    assert plot_fold_curve(curve, ax=given, label="here") is given


def test_a_lift_response_has_a_line_a_tension_dashed_where_it_is_never_reached_and_the_rigid_wing_dotted():
    wing = membrane_wing(QuasiLinearMembrane(n_modes=3), thin_airfoil(3))
    response = lift_response(wing, [0.1, 1.0, 10.0], tensions=[1.0, 4.0])
    ax = response.plot()
    divergent, stable, rigid = ax.get_lines()
    assert (divergent.get_linestyle(), stable.get_linestyle(), rigid.get_linestyle()) == ("--", "-", ":")
    np.testing.assert_allclose(stable.get_ydata(), 20.0 * np.log10(abs(response.membrane[1])))
    np.testing.assert_allclose(rigid.get_ydata(), 20.0 * np.log10(abs(response.rigid)))
    assert legend(ax) == ["$c_T = 1$ (unstable)", "$c_T = 4$", "rigid wing"]
    assert ax.get_xscale() == "log"
    assert response.plot(ax=ax) is ax


def test_an_unknown_output_and_an_unknown_harmonic_are_refused(branch):
    with pytest.raises(KeyError, match=r"unknown output 'y' \(known: x\)"):
        branch.plot("y")
    for harmonic in (6, -1):
        with pytest.raises(ValueError, match=f"harmonic is {harmonic}; give an integer from 0 to 5"):
            branch.plot("x", harmonic=harmonic)


def test_figures_can_be_written(branch, tmp_path):
    branch.plot("x").figure.savefig(tmp_path / "branch.png")
    assert (tmp_path / "branch.png").stat().st_size > 5000


def test_the_kinds_of_special_points_that_are_marked_can_be_chosen(absorber):
    assert Kind.FOLD.value in legend(absorber.plot("x1", special={Kind.FOLD}))
    assert Kind.NEIMARK_SACKER.value not in legend(absorber.plot("x1", special={Kind.FOLD}))


def test_frequencies_on_a_logarithmic_axis_are_written_as_numbers(branch):
    ax = plt.subplots()[1]
    ax.set_xscale("log")
    branch.plot("x", ax=ax)
    ax.set_xlim(0.05, 50.0)
    ax.figure.canvas.draw()
    assert {"0.1", "1", "10"} <= {tick.get_text() for tick in ax.get_xticklabels()}
