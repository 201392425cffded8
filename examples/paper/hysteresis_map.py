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

*An isola.* The lower edge of the first tongue dips between :math:`\omega = 2.9` and 6.2 (:doc:`first_tongue`):
between its extrema, from 1.18 to 1.29 degrees, the resonant motion is a loop of its own, which no march from rest
meets.

90 s.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp
from hbnlp.testing import stored_result

membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
problem = hbnlp.HarmonicBalance(wing, n_harmonics=1)
spans = {"limits": (0.5, 150.0), "span": (np.radians(0.1), np.radians(12.0))}


def distance(omega, amplitude, curve):
    """Return how far a fold is from a curve, in logarithms, to the width of its steps."""
    steps = np.linspace(0.0, len(curve) - 1.0, 40 * len(curve))
    first, second = (np.interp(steps, np.arange(len(curve)), np.log(a)) for a in (curve.first, curve.second))
    return np.hypot(first - np.log(omega), second - np.log(amplitude)).min()


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
            if all(distance(fold.value, at["pitch_amplitude"], curve) > 5e-3 for curve in curves):
                curves.append(hbnlp.follow(fold, "pitch_amplitude", **spans))
    return sorted(curves, key=lambda curve: curve.cusps[0].first)


curves, of_three = fold_curves(problem), fold_curves(problem.with_harmonics(3))
to_tolerance = fold_curves(problem, (0.5,), hbnlp.HarmonicBalance(wing, tolerance=1e-3))
for number, group in (("1 harmonic", curves), ("3 harmonics", of_three), ("a tolerance", to_tolerance)):
    for curve in group:
        print(f"{number}: {curve.n_harmonics.min()} to {curve.n_harmonics.max()} harmonics, {curve!r}")

# where the resonant motion has a camber of a tenth, down to the amplitude at which this curve turns
events = {"camber 0.1": lambda s: s.amplitude_squared("midchord") - 0.01}
branch = hbnlp.trace(problem, "omega", (0.5, 8.0), at={"pitch_amplitude": np.radians(2.5)}, events=events)
unsafe = hbnlp.follow(branch.of_kind("event")[0], "pitch_amplitude", limits=(0.5, 5.9), span=spans["span"])
cambers = [wing.validity(unsafe.solution(i)).camber[0] for i in range(0, len(unsafe), 5)]
assert np.allclose(cambers, 0.1, rtol=0.01)


def cusps_of(group):
    return np.array([[curve.cusps[0].first, curve.cusps[0].second] for curve in group])


nearest = np.abs(np.log(cusps_of(of_three)[:, None, 0] / cusps_of(curves)[None, :, 0])).min(axis=1)
further = [curve for curve, distance in zip(of_three, nearest, strict=True) if distance > 0.01]

figure, plane = plt.subplots(figsize=(9, 5), layout="constrained")
points = np.genfromtxt(stored_result("wing_tongue_quasi_linear.csv"), delimiter=",", names=True, usecols=(0, 1, 2))
points = points[np.isfinite(points["n_harmonics"])]  # without the events, which have no number
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

plane.set(xscale="log", yscale="log", ylim=spans["span"])
degrees, omegas = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0), (1, 3, 10, 30, 100)
plane.set_yticks([], minor=True)
plane.set_yticks(np.radians(degrees), [f"{value:g}" for value in degrees])
plane.set_xticks(omegas, [f"{value:g}" for value in omegas])
plane.set_ylabel("pitch amplitude (degrees)")
plane.legend(fontsize="x-small", loc="upper left", frameon=False)
figure.savefig("hysteresis_map.png", dpi=110)

turns = [np.degrees(turn.second) for turn in (*curves[0].isola_births, *curves[0].isola_merges)]
np.testing.assert_allclose(turns, [1.1801, 1.2929], atol=1e-3)
assert np.all(abs(cusps_of(to_tolerance) / cusps_of(curves)[1:] - 1.0) < (1e-3, 1e-2))
assert len(further) == 3
