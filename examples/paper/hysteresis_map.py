r"""
The hysteresis map of the wing: its folds in frequency and amplitude
====================================================================

Every fold of the response of the paper's wing (Re = 100, :math:`c_{T0} = 1`) is followed in the pitching frequency
and amplitude. The folds of a mode form a tongue that begins in a cusp: below its amplitude that mode's resonance is
single-valued, within the tongue a resonant and a quiet motion exist. The tongues of the higher modes begin at
smaller amplitudes, because the load of a pitching frame grows as :math:`\omega^2`.

*What one trace does not reach.* At 2.5 degrees (dotted) a trace from low frequencies meets the folds of the first
tongue alone. The map shows that the tongues of higher modes reach over that amplitude: their folds belong to
detached branches, which :doc:`all_solutions` finds by a search.

*Unsafe to use* (shaded): the camber of the first resonant motion exceeds a tenth of the chord, where the
quasi-linear membrane is no model any more: an event of the branch, followed in both parameters down to 1.18
degrees, below which the motion traced from low frequencies is the quiet one. To the right it holds as far as that
motion exists. The band of the aerodynamic model, :math:`\omega` from 0.01 to 1000, holds every harmonic drawn here.

*How much depends on the harmonics.* The tongues are drawn to a tolerance of 1e-3, with the harmonics that this
takes: three to nineteen for the higher ones, up to 29 for the first. Thin lines have one harmonic: each of their
cusps is within 0.1 per cent in frequency and one per cent in amplitude, so that the map of the onsets is one of
first harmonics. With three harmonics there are three further, shorter tongues, from 6.0, 17.7 and 29.2 on, where a
higher mode resonates with the third harmonic of the motion.

*An isola.* The lower edge of the first tongue dips between :math:`\omega = 2.9` and 6.2 (circle and square):
between its extrema, from 1.18 to 1.29 degrees, the resonant motion is a loop of its own, which no march from rest
meets.

*To a tolerance* (right) the first tongue is there again, with both membranes, as followed with 15 to 37 harmonics
and stored (``benchmarks/validation/membrane_wing/first_tongue.py``): it begins in a cusp at :math:`(\omega,
\alpha_2)` = (2.535, 1.236 degrees), with the full membrane at (2.539, 1.242), and dips to 1.200 and 1.231 degrees.
The full membrane's lower edge goes on beyond :math:`\omega = 9.7` through further cusps, one at (6.499, 2.363)
among them.

60 s.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp
from hbnlp.testing import stored_result

membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
problem = hbnlp.HarmonicBalance(wing, n_harmonics=1)
spans = {"limits": (0.5, 150.0), "span": (np.radians(0.1), np.radians(12.0))}


def on_a_curve(omega, amplitude, curves):
    """Return whether a fold lies on one of the curves, to the width of their steps."""
    for curve in curves:
        steps = np.linspace(0.0, len(curve) - 1.0, 40 * len(curve))
        first, second = (np.interp(steps, np.arange(len(curve)), np.log(a)) for a in (curve.first, curve.second))
        if np.hypot(first - np.log(omega), second - np.log(amplitude)).min() < 5e-3:
            return True
    return False


def finer_fold(problem, branch, fold):
    """Return the fold of a problem with more harmonics that is beside one of a branch."""
    beside = branch.solution(fold.index - 3)
    motion = hbnlp.solve(problem, at=dict(beside.parameters), start=beside)
    return hbnlp.trace(motion, "omega", (motion.omega, 2.0 * fold.value - motion.omega), stability=None).folds[0]


def fold_curves(problem, amplitudes=(2.5, 1.0, 0.5), finer=None):
    """Return the curves of all folds, those of a finer problem, if there is one, beside those that traces meet."""
    curves = []
    for degrees in amplitudes:
        at = {"pitch_amplitude": np.radians(degrees)}
        branch = hbnlp.trace(problem, "omega", (0.02, 100.0), at=at, stability=None)
        for fold in branch.folds if finer is None else [finer_fold(finer, branch, each) for each in branch.folds]:
            if not on_a_curve(fold.value, at["pitch_amplitude"], curves):
                curves.append(hbnlp.follow(fold, "pitch_amplitude", **spans))
    return sorted(curves, key=lambda curve: curve.cusps[0].first)


curves, of_three = fold_curves(problem), fold_curves(problem.with_harmonics(3))
to_tolerance = fold_curves(problem, (0.5,), hbnlp.HarmonicBalance(wing, tolerance=1e-3))
for number, group in (("1 harmonic", curves), ("3 harmonics", of_three), ("a tolerance", to_tolerance)):
    for curve in group:
        cusp = curve.cusps[0]
        print(f"{number}: cusp at omega = {cusp.first:.4f}, {np.degrees(cusp.second):.4f} degrees; {curve!r}")

# where the resonant motion has a camber of a tenth, down to the amplitude at which this curve turns
events = {"camber 0.1": lambda s: s.amplitude_squared("midchord") - 0.01}
branch = hbnlp.trace(problem, "omega", (0.5, 8.0), at={"pitch_amplitude": np.radians(2.5)}, events=events)
unsafe = hbnlp.follow(branch.of_kind("event")[0], "pitch_amplitude", limits=(0.5, 5.9), span=spans["span"])
phase = np.linspace(0.0, 2.0 * np.pi, 64)
motions = [unsafe.solution(i) for i in range(0, len(unsafe), 5)]
cambers = [membrane.camber(motion.displacement(phase / motion.omega)).max() for motion in motions]
assert np.allclose(cambers, 0.1, rtol=0.01)


def stored_tongue(membrane):
    """Return points and events of the first tongue to a tolerance."""
    path = stored_result(f"wing_tongue_{membrane}.csv")
    rows = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")
    return rows[rows["event"] == ""], rows[rows["event"] != ""]


def cusps_of(group):
    return np.array([[curve.cusps[0].first, curve.cusps[0].second] for curve in group])


nearest = np.abs(np.log(cusps_of(of_three)[:, None, 0] / cusps_of(curves)[None, :, 0])).min(axis=1)
further = [curve for curve, distance in zip(of_three, nearest, strict=True) if distance > 0.01]

figure, (plane, first) = plt.subplots(1, 2, figsize=(13, 5), width_ratios=(3, 2), layout="constrained")
points, _ = stored_tongue("quasi_linear")
plane.plot(points["omega"], np.radians(points["degrees"]), color="C0", label="tongue 1")
for number, curve in enumerate(to_tolerance, start=1):
    curve.plot(ax=plane, color=f"C{number}", label=f"tongue {number + 1}")
for group, style, label in ((curves, "-", "one harmonic"), (further, "--", "three harmonics: further tongues")):
    for curve in group:
        options = {"color": "0.4", "linewidth": 0.6, "linestyle": style, "zorder": 1, "special": False}
        curve.plot(ax=plane, label=label if curve is group[0] else "_", **options)
unsafe.plot(ax=plane, color="0.7", label="camber > 0.1, resonant", zorder=0)
edge = plane.get_lines()[-1]
plane.fill_betweenx(edge.get_ydata(), edge.get_xdata(), 200.0, color="0.92", zorder=0)
plane.axhline(np.radians(2.5), color="0.5", linewidth=0.6, linestyle=":")
plane.set(xlim=(1.0, 150.0), title="folds, and the cusps where they begin")

# the first tongue to a tolerance
cusps_to = {}
curves[0].plot(ax=first, color="0.6", linewidth=0.8, label="one harmonic", special=False)
for membrane_name, color in (("quasi-linear", "C0"), ("nonlinear", "C3")):
    points, events = stored_tongue(membrane_name.replace("-", "_"))
    label = f"{membrane_name.replace('nonlinear', 'full')} membrane, to 1e-3"
    first.plot(points["omega"], np.radians(points["degrees"]), color=color, label=label)
    cusp = min(events[events["event"] == "cusp"], key=lambda row: row["omega"])
    cusps_to[membrane_name] = cusp["omega"], cusp["degrees"]
    for kind, marker in (("cusp", "*"), ("isola birth", "o"), ("isola merge", "s")):
        chosen = events[events["event"] == kind]
        first.plot(chosen["omega"], np.radians(chosen["degrees"]), marker, color=color, markersize=5)
first.set(xlim=(2.2, 12.0), title="the first tongue, to a tolerance")
for ax, span in ((plane, spans["span"]), (first, np.radians((1.0, 4.0)))):
    ax.set(xscale="log", yscale="log", ylim=span)
    ticks = [
        degrees
        for degrees in (0.1, 0.2, 0.5, 1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0)
        if span[0] <= np.radians(degrees) <= span[1]
    ]
    ax.set_yticks(np.radians(ticks), [f"{degrees:g}" for degrees in ticks])
    ax.set_yticks([], minor=True)
    ax.set_xticks([], minor=True)
    ticks = (1, 3, 10, 30, 100) if ax is plane else (2.5, 3, 4, 5, 6, 8, 10)
    ax.set_xticks(ticks, [f"{omega:g}" for omega in ticks])
    ax.set_ylabel("pitch amplitude (degrees)")
plane.legend(fontsize="x-small", loc="upper left", frameon=False)
first.legend(fontsize="small", loc="upper left")
figure.savefig("hysteresis_map.png", dpi=110)

degrees = [np.degrees(turn.second) for turn in (*curves[0].isola_births, *curves[0].isola_merges)]
finest = np.vstack([[cusps_to["quasi-linear"][0], np.radians(cusps_to["quasi-linear"][1])], cusps_of(to_tolerance)])
np.testing.assert_allclose(finest[:, 0], cusps_of(curves)[:, 0], rtol=1e-3)
np.testing.assert_allclose(finest[:, 1], cusps_of(curves)[:, 1], rtol=1e-2)
np.testing.assert_allclose(degrees, [1.1801, 1.2929], atol=1e-3)
assert len(further) == 3
np.testing.assert_allclose(cusps_to["nonlinear"], [2.5386, 1.2423], atol=1e-4)
