r"""
The paper's hysteresis: lift of a membrane wing at Re = 100
===========================================================

The case of Nardini, Illingworth and Sandberg: a membrane wing (:math:`\mu = 0.5`, :math:`Eh = 250`, :math:`\delta_0
= 0.002`, so that :math:`c_{T0} = 1`) pitches about its leading edge, :math:`\alpha = \alpha_2 \sin \omega t` with
:math:`\alpha_2 = 2.5^\circ`, at a chord Reynolds number of 100. One command, some 20 s, follows the response from
low frequencies to :math:`\omega = 12`, what crosses it, and what the quiet motion there is connected with, each
with as many harmonics as a tolerance of 1e-3 asks for (11 to 47). Full lines are stable, broken ones unstable.

*The interval with hysteresis.* From the fold at :math:`\omega = 4.577` on, a quiet motion exists beside the
resonant one, with 20 dB less lift, and an unstable one between them. The resonant motion loses its symmetry at a
branch point at 8.323, beyond which an asymmetric one, with even harmonics, is stable; as a symmetric one it ends at
a fold at 9.150. The quiet motion is modulated between two Neimark-Sacker points, at 5.789 and 7.505. At each of
these folds a Floquet multiplier is 1: they are ends of the wing's motion, not of equations that were cut off.

*Marches.* Triangles are slow marches of the wing's equations by Runge-Kutta, up from rest at :math:`\omega = 0.5`
and down from rest at 70, stored since they take minutes (:doc:`figure_5_harmonics`). They run along the stable
lines and fall at their ends. Beyond 12 they are what is drawn: the asymmetric motion stays to 39.4.

*Where motions end.* The bars are stable motions, each named by the mode that is largest in it, their ends traced to
the same tolerance and stored (``benchmarks/validation/membrane_wing/diagram.py`` makes them, in some minutes): the
first mode's ends at a fold at 39.357; the quiet motion becomes the second mode's at 16.047, asymmetric as well; the
third mode's, on a branch of its own, begins at a Neimark-Sacker point at 27.654. Above :math:`\omega = 5.4`,
though, the camber of the resonant motion exceeds a tenth of the chord, more than the membrane's model is made for:
what wing and model share lies to the left of that (right picture).
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp
from hbnlp.testing import stored_result

membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
problem = hbnlp.HarmonicBalance(wing, tolerance=1e-3)
pitch = {"pitch_amplitude": np.radians(2.5)}
diagram = hbnlp.explore(problem, "omega", (0.1, 12.0), at=pitch, callbacks=[hbnlp.ProgressBar()])
print(diagram)
for junction in diagram.special_points:
    print(f"  {junction.point}, multiplier {junction.point.multiplier:.4f}")
for interval in diagram.intervals():
    print(f"  {interval}")

resonant = wing.validity(diagram.branches[0])
limit = diagram.branches[0].parameter[np.argmax(resonant.camber > resonant.limits.camber)]
linear = hbnlp.lift_response(wing, np.geomspace(0.1, 70.0, 400), tensions=[1.0])


def stored(name):
    return np.genfromtxt(stored_result(f"wing_{name}.csv"), delimiter=",", names=True, dtype=None, encoding="utf-8")


points = stored("points_quasi_linear")
ends = points["omega"][points["changes"] == 1]
stable = {
    "first mode": (0.1, 39.35736),
    "quiet": (4.57710, 16.04697),
    "second": (16.04697, 70.0),
    "third": (27.65356, 70.0),
}
for value in {value for interval in stable.values() for value in interval} - {0.1, 70.0}:
    assert np.min(abs(ends - value)) < 1e-5

style = {"markersize": 4.0, "zorder": 1, "markeredgewidth": 0.0}
figure, (ax, near) = plt.subplots(1, 2, figsize=(12, 5), width_ratios=(2, 1), layout="constrained")
ax.set(xscale="log", title="pitch amplitude 2.5 degrees")
near.set(title="where the model holds")
for each in (ax, near):
    each.plot(linear.omega, 20.0 * np.log10(abs(linear.membrane[0])), ":", color="0.5", label="linear membrane")
    for way, marker, colour in (("up", "^", "0.3"), ("down", "v", "0.6")):
        march = stored(f"march_quasi_linear_{way}")
        gain = march["lift_1"] / (pitch["pitch_amplitude"] * march["omega"] ** 2)
        each.plot(march["omega"], 20.0 * np.log10(gain), marker, label=f"marched {way}", **style | {"color": colour})
    diagram.plot("C_L", ax=each, per="alpha_acceleration", decibels=True)
    each.set_ylabel(r"$|C_L| \,/\, |\alpha''|$ (dB)")
for level, (name, (low, high)), colour in zip(
    (-54, -63, -63, -72), stable.items(), ("C0", "C2", "C4", "C5"), strict=True
):
    ax.hlines(level, low, high, color=colour, linewidth=4.0)
    ax.text(high, level + 1.0, name, color=colour, fontsize="small", ha="right", va="bottom")
near.set(xlim=(4.0, 6.0), ylim=(-20.0, 16.0))
near.axvspan(limit, 6.0, color="0.94", zorder=0)
near.text(limit + 0.03, 6.0, "camber > 0.1\n(resonant)", color="0.4", fontsize="small")
near.get_legend().remove()
legend = ax.get_legend()  # two columns above the curves: the bars are below them
ax.legend(legend.legend_handles, [text.get_text() for text in legend.texts], ncols=2, loc="upper right", frameon=False)
figure.savefig("figure_4_hysteresis.png", dpi=110)

found = {(junction.point.kind.value, round(junction.point.value, 3)) for junction in diagram.special_points}
assert {("fold", 4.577), ("fold", 9.15), ("branch point", 8.323), ("Neimark-Sacker", 5.789)} <= found
folds = [junction.point for junction in diagram.special_points if junction.point.kind is hbnlp.Kind.FOLD]
assert all(abs(fold.multiplier - 1.0) < 1e-4 for fold in folds)
for march, left in (("up", 9.1496), ("down", 4.5771)):
    branch = 0 if march == "up" else 2
    falls = diagram.march(march, branch=branch, integrated=False).falls
    assert abs(falls[0].falls_at - left) < 1e-4
assert 5.2 < limit < 5.5
print(f"camber of the resonant motion above a tenth from omega = {limit:.3f} on")
