r"""
The paper's hysteresis: lift of a membrane wing at Re = 100
===========================================================

The case of Nardini, Illingworth and Sandberg: a membrane wing (:math:`\mu = 0.5`, :math:`Eh = 250`, :math:`\delta_0 =
0.002`, so that :math:`c_{T0} = 1`) pitches about its leading edge, :math:`\alpha = \alpha_2 \sin \omega t` with
:math:`\alpha_2 = 2.5^\circ`, at a chord Reynolds number of 100. One trace with five harmonics, some 20 s, follows the
response from low frequencies to high ones through all its folds; full lines are stable, broken ones unstable.

*The interval with hysteresis.* From the fold at :math:`\omega = 4.577` on, a quiet motion exists beside the resonant
one, with 20 dB less lift, and an unstable one between them. With five harmonics the resonant motion loses its stability
to an asymmetric one, with even harmonics, at :math:`\omega = 8.34`. As a solution it goes on: the peak leans over, to a
fold near 44 (48 with one harmonic, grey). But above :math:`\omega = 5.4` its camber exceeds a tenth of the chord, more
than the membrane's model is made for. What wing and model share lies to the left of that (right picture).

*The quiet motion* is unstable as well between two Neimark-Sacker points, at :math:`\omega = 5.79` and 7.51, where it
becomes quasi-periodic, and between branch points at 15.9 and 45.7.

*Which folds to believe.* At a fold of the wing's motion the Floquet multiplier of its null vector is 1. At 4.577 it is
1.0001, at 6.78 and 17.8 on the unstable branch within two per cent of 1. At the pair of folds at 4.750 and 4.829 it is
nowhere near, and both sides are stable: those belong to the truncated equations, whose highest harmonic resonates
there. With seven harmonics they are gone, and 4.577 stays. The end of the resonant branch, near 44 to 47, is no better.

*Where motions really end.* The bars are stable motions with as many harmonics as a tolerance of 1e-3 asks for, each
named by the mode that is largest in it: the first mode's, asymmetric from 8.32 on, ends at a fold at 39.357; the quiet
motion (modulated from 5.79 to 7.50) becomes the second mode's at 16.047, asymmetric as well; the third mode's, on a
branch of its own, begins at a Neimark-Sacker point at 27.654. :doc:`figure_5_harmonics` holds them to direct
integration. These points are stored (``benchmarks/validation/membrane_wing/diagram.py`` makes them, in some minutes).
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp
from hbnlp.testing import stored_result

membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
pitch = {"pitch_amplitude": np.radians(2.5)}

problem = hbnlp.HarmonicBalance(wing, n_harmonics=5)
branch = hbnlp.trace(problem, "omega", (0.1, 60.0), at=pitch, callbacks=[hbnlp.ProgressBar()])
print(branch)
for point in branch.special_points:
    print(f"  {point}, multiplier {point.multiplier:.4f}")

one = hbnlp.HarmonicBalance(wing, n_harmonics=1)
single = hbnlp.trace(one, "omega", (0.1, 60.0), at=pitch, stability=None)
linear = hbnlp.lift_response(wing, np.geomspace(0.1, 60.0, 400), tensions=[1.0])

phase = np.linspace(0.0, 2.0 * np.pi, 64)
camber = [membrane.camber(s.displacement(phase / s.omega)).max() for s in map(branch.solution, range(len(branch)))]
excessive = int(np.argmax(np.array(camber) > 0.1))
limit = branch.parameter[excessive]

path = stored_result("wing_points_quasi_linear.csv")
points = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")
ends = points["omega"][points["changes"] == 1]
stable = {
    "first mode": (0.1, 39.35736),
    "quiet": (4.57710, 16.04697),
    "second": (16.04697, 60.0),
    "third": (27.65356, 60.0),
}
for value in {value for interval in stable.values() for value in interval} - {0.1, 60.0}:
    assert np.min(abs(ends - value)) < 1e-5

figure, (ax, near) = plt.subplots(1, 2, figsize=(12, 5), width_ratios=(2, 1), layout="constrained")
ax.set(xscale="log", title="pitch amplitude 2.5 degrees, five harmonics")
near.set(title="where the model holds")
for each in (ax, near):
    gain = abs(single.harmonics("C_L")[:, 1] / single.harmonics("alpha_acceleration")[:, 1])
    each.plot(linear.omega, 20.0 * np.log10(abs(linear.membrane[0])), ":", color="0.5", label="linear membrane")
    each.plot(single.parameter, 20.0 * np.log10(gain), color="0.7", linewidth=0.8, label="one harmonic")
    branch.plot("C_L", ax=each, per="alpha_acceleration", decibels=True)
    each.set_ylabel(r"$|C_L| \,/\, |\alpha''|$ (dB)")
for row, (name, (low, high)) in enumerate(stable.items()):
    level = -54.0 - 9.0 * (row - (row > 1))
    ax.hlines(level, low, high, color=f"C{row}", linewidth=4.0)
    ax.text(high, level + 1.0, name, color=f"C{row}", fontsize="small", ha="right", va="bottom")
near.set(xlim=(4.0, 6.0), ylim=(-20.0, 16.0))
near.axvspan(limit, 6.0, color="0.94", zorder=0)
near.text(limit + 0.03, 6.0, "camber > 0.1\n(resonant)", color="0.4", fontsize="small")
near.get_legend().remove()
legend = ax.get_legend()  # two columns above the curves: the bars are below them
ax.legend(legend.legend_handles, [text.get_text() for text in legend.texts], ncols=2, loc="upper right", frameon=False)
figure.savefig("figure_4_hysteresis.png", dpi=110)

assert branch.end is hbnlp.End.SPAN_END
onset = min(branch.folds, key=lambda fold: fold.value)
assert abs(onset.value - 4.576971) < 1e-5
assert [fold for fold in branch.folds if abs(fold.multiplier - 1.0) < 1e-3] == [onset]
torus = sorted(point.value for point in branch.special_points if point.kind is hbnlp.Kind.NEIMARK_SACKER)
np.testing.assert_allclose(torus, [5.78894, 7.50792], atol=1e-3)
assert 5.2 < limit < 5.5
print(f"onset at omega = {onset.value:.6f}, multiplier {onset.multiplier:.6f}; camber > 0.1 above {limit:.3f}")
