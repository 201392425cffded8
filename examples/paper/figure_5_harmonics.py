r"""
The paper's harmonics, and slow marches by direct integration
=============================================================

The paper's wing at 2.5 degrees, with the quasi-linear membrane and (upper right) with the full one. Curves are motions
traced to a tolerance of 1e-3, with as many harmonics as that needs (11 to 47), stable ones thick. Triangles are marches
by Runge-Kutta, the state carried over: up from rest at :math:`\omega = 0.5`, down from rest at 70, with steps that
halve down to 0.3 per cent where a motion is left. Both are stored, as they take some minutes each
(``benchmarks/validation/membrane_wing``).

*Where the motions end.* March and trace know nothing of each other, and agree to 0.5 per cent wherever a response has
settled, most to 0.01. The quasi-linear membrane, marched up, leaves the symmetric motion at a fold at 9.150 for an
asymmetric one, with even harmonics, born at a branch point at 8.323, and stays with that to a fold at 39.357, where it
falls by 48 dB. Each of these folds has a multiplier of 1: they are ends of the wing's motion, not of the equations cut
off. A march down leaves the quiet motion at the fold at 4.577. ``Diagram.march`` tells the same falls from the traced
motions alone, and that from modulated ones within a per cent of where the march has it.

*The full membrane* stiffens more, with the exact arc's length: its symmetric motion ends at 7.605, its asymmetric one
at 15.967 already, far from the quasi-linear one's 39.357.

*What a march down meets* hangs on where it begins. From rest at 70 it is a resonant motion of a higher mode, on a
branch of its own; it becomes modulated near 28 and falls at 24.4 to the asymmetric quiet motion that ends in the
symmetric one at 16.05. The full membrane's is modulated twice, from 52 to 49.5 and from 25 to 23.5.

*Lower right:* one, three, five and seven harmonics, marched by Newton's method as the paper does. All leave the quiet
motion at 4.6. How far up the resonant motion reaches they do not agree: a march leaves it near 48, 42 and 44 with one,
three and five harmonics; with seven at 9.3, near the true end of the symmetric motion, and for the quiet one: a
symmetric motion has nothing in it from which Newton's method could find the asymmetric one.

14 s.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp
from hbnlp.testing import stored_result

pitch = {"pitch_amplitude": np.radians(2.5)}


def stored(name):
    return np.genfromtxt(stored_result(f"wing_{name}.csv"), delimiter=",", names=True, dtype=None, encoding="utf-8")


def decibels(rows, harmonic=1):
    amplitude = np.where(rows[f"lift_{harmonic}"] > 0.0, rows[f"lift_{harmonic}"], np.nan)
    return 20.0 * np.log10(amplitude / (pitch["pitch_amplitude"] * rows["omega"] ** 2))


figure, axes = plt.subplots(2, 2, figsize=(13, 10), layout="constrained")
falls = {}
for ax, membrane in zip(axes[0], ("quasi_linear", "nonlinear"), strict=True):
    curve, points = stored(f"diagram_{membrane}"), stored(f"points_{membrane}")
    ends, falls[membrane] = points["omega"][points["changes"] == 1], set()
    for number in np.unique(curve["branch"]):
        part = curve[curve["branch"] == number]
        ax.plot(part["omega"], decibels(part), "--", color="0.6", linewidth=0.7)
        ax.plot(part["omega"], np.where(part["stable"], decibels(part), np.nan), color="0.35", linewidth=1.6)
        for k, harmonic in enumerate((1, 3, 5, 7) if membrane == "quasi_linear" else ()):
            level = np.where(part["stable"], decibels(part, harmonic), np.nan)
            axes[1, 0].plot(part["omega"], level, color=f"C{k}", linewidth=1.6)
    for way, marker, colour in (("up", "^", "C0"), ("down", "v", "C3")):
        march = stored(f"march_{membrane}_{way}")
        ax.plot(march["omega"], decibels(march), marker, color=colour, markersize=3.5, label=f"marched {way}")
        for k, harmonic in enumerate((1, 3, 5, 7) if membrane == "quasi_linear" else ()):
            label = f"harmonic {harmonic}" if way == "up" else None
            style = {"color": f"C{k}", "markersize": 2.5, "label": label}
            axes[1, 0].plot(march["omega"], decibels(march, harmonic), marker, **style)
        for i in np.flatnonzero(march["jump"]):
            low, high = sorted(march["omega"][i - 1 : i + 1])
            inside = ends[(low < ends) & (ends < high)]
            modulated = march["between"][i - 1] > 0.05 * march["lift_1"][i - 1]
            print(f"{membrane}, {way}: left between {low:.3f} and {high:.3f}; ends there:", inside, modulated)
            falls[membrane] |= {round(float(end), 3) for end in inside}
assert falls["quasi_linear"] == {4.577, 9.150, 39.357}
assert {4.548, 7.605, 15.967} <= falls["nonlinear"]

# one, three, five and seven harmonics, marched by Newton's method
membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
omega, left = np.geomspace(0.3, 60.0, 130), {}
for h, colour in ((1, "0.6"), (3, "C0"), (5, "C1"), (7, "C3")):
    problem = hbnlp.HarmonicBalance(wing, n_harmonics=h)
    for way, values in (("up", omega), ("down", omega[::-1])):
        march = hbnlp.sweep(problem, "omega", values, at=pitch)
        left[h, way] = march.jump_brackets.mean(axis=1)
        print(f"H = {h} {way:>4}: jumps at omega =", ", ".join(f"{w:.2f}" for w in left[h, way]))
        style = {"color": colour, "linestyle": "-" if way == "up" else "--", "marker": ""}
        march.plot("C_L", ax=axes[1, 1], per="alpha_acceleration", decibels=True, label=f"H = {h}, {way}", **style)
assert all(abs(left[h, "down"][-1] - 4.6) < 0.1 for h in (1, 3, 5, 7))
np.testing.assert_allclose([left[h, "up"][0] for h in (1, 3, 5, 7)], [48.0, 42.3, 44.1, 9.26], rtol=0.03)

titles = ("quasi-linear membrane", "full membrane", "quasi-linear: harmonics 1, 3, 5, 7", "marched by Newton's method")
for ax, title, lowest in zip(axes.flat, titles, (-40.0, -40.0, -95.0, -40.0), strict=True):
    ax.set(xscale="log", xlabel=r"$\omega c/U$", ylabel="", title=title, xlim=(0.3, 80.0), ylim=(lowest, 45.0))
    ax.legend(loc="lower left", fontsize="small")
for ax in axes[:, 0]:
    ax.set_ylabel(r"$|C_L| \,/\, |\alpha''|$ (dB)")
figure.savefig("figure_5_harmonics.png", dpi=110)
