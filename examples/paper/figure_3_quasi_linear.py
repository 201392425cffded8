r"""
The paper's quasi-linear response: twenty amplitudes, marched up and down
=========================================================================

Lift per pitching acceleration of the paper's wing with one harmonic, for pitch amplitudes from 0.5 to 10 degrees by
0.5, marched up from :math:`\omega = 0.01` (left) and down from :math:`\omega = 100` (middle). Dots: folds.

Marching up, the response stays resonant and leaves the first mode's peak at a fold that rises fast with the
amplitude: :math:`\omega = 17` at 1.5 degrees, 48 at 2.5, beyond the picture from 4 degrees on. Marching down, it
jumps several times: each jump is the end of the quiet motion of one mode's tongue (:doc:`hysteresis_map`), at
2.5 degrees at :math:`\omega = 89.9`, 59.5, 34.8, 16.7 and 4.5.

*Every jump has its fold*: a trace from the last solution before each of the 74 jumps folds in its bracket (dots),
so that none is a failure of Newton's method. Where it lands is Newton's choice: at 7 and 9 degrees a march down
jumps once, unlike its neighbours, as it comes from the fold of the second mode's motion, at 47.0 and 60.8, to the
first mode's resonant motion at once. The motions in between are there as well, and the quiet one ends at 12.74 and
16.47, between the neighbours' last jumps.

*To a tolerance* of 1e-2 (right, filled): where `Diagram.march` falls, up to a frequency of 60, and down from rest
at 60 and at 20, along motions of as many harmonics as they need; landings are found by integration, and where it
leads to no traced motion the march ends. Stored; ``benchmarks/validation/membrane_wing/amplitudes.py`` makes it.
Marching down, the quiet motion of the first mode ends within two per cent of one harmonic's fold at the amplitudes
at which the march is on it (0.5 to 2.5 degrees, 3.5, 4 and 5); at the others it comes from another motion, which
ends earlier. What one harmonic has not: marching up, the motion ends at a fold, from 6.2 at 1.5 degrees to 30.7 at
10 (from 4.5 degrees on that of an asymmetric motion, beyond a branch point), and the asymmetric one to which it
falls up to 3 degrees at another, 14.2, 25.8, 39.4 and 55.5 at 1.5, 2, 2.5 and 3; and from 3.5 degrees on the
resonant motion has a loop of its own, from 3.4 to 7 in :math:`\omega`, 0.3 per cent wide at 3.5 degrees and 16 at
9.5, where a harmonic meets a higher mode. Marching down from 60, it falls first between 18.9 and 53.

Forty marches of 240 frequencies take 28 s. Above a camber of a tenth of the chord, on the resonant motion from
:math:`\omega` about 6 on, this is mathematics only.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp
from hbnlp.testing import stored_result

membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
problem = hbnlp.HarmonicBalance(wing, n_harmonics=1)
omega = np.geomspace(0.01, 100.0, 240)

marches, jumps, folds = {}, {}, {}
for way, values in (("up", omega), ("down", omega[::-1])):
    for degrees in np.arange(0.5, 10.01, 0.5):
        march = hbnlp.sweep(problem, "omega", values, at={"pitch_amplitude": np.radians(degrees)})
        marches[way, degrees], jumps[way, degrees] = march, march.jump_brackets.mean(axis=1)
        folds[way, degrees] = []
        for bracket in march.jump_brackets:
            last = march.solution(int(np.flatnonzero(march.parameter == bracket[0])[0]))
            folds[way, degrees].append(hbnlp.trace(last, "omega", tuple(bracket), stability=None).folds[0])
        print(f"{way:5s} {degrees:4.1f} degrees: jumps at omega =", ", ".join(f"{w:.3f}" for w in jumps[way, degrees]))
assert len(jumps["up", 2.5]) == 1
assert len(jumps["down", 2.5]) >= 3
assert abs(jumps["down", 2.5][-1] - 4.53) < 0.2

print(f"{sum(map(len, folds.values()))} jumps, each with a fold in its bracket")
assert sum(map(len, folds.values())) == sum(map(len, jumps.values()))

# %%
# At 7 and 9 degrees the quiet motion, from that of a neighbour where that has landed on it: it ends at a fold, too.
quiet = marches["down", 6.5].solution(int(np.argmin(abs(omega[::-1] - 30.0))))
amplitudes, ends = np.radians(np.linspace(6.5, 9.0, 26)), {}
along = hbnlp.sweep(problem, "pitch_amplitude", amplitudes, at={"omega": quiet.omega}, start=quiet)
for degrees in (7.0, 9.0):
    motion = along.solution(int(np.argmin(abs(amplitudes - np.radians(degrees)))))
    ends[degrees] = hbnlp.trace(motion, "omega", (quiet.omega, 5.0), stability=None).folds[0].value
    neighbours = [jumps["down", degrees + step][-1] for step in (-0.5, 0.5)]
    print(f"{degrees:g} degrees: the quiet motion ends at {ends[degrees]:.3f}, its neighbours' near", *neighbours)
    assert len(jumps["down", degrees]) == 1
    assert neighbours[0] < ends[degrees] < neighbours[1]

# %%
# Falls of slow marches to a tolerance beside the folds of one harmonic.
read = {"delimiter": ",", "names": True, "dtype": None, "encoding": "utf-8"}
falls = {highest: np.genfromtxt(stored_result(f"wing_amplitudes_{highest}.csv"), **read) for highest in (20, 60)}

figure, axes = plt.subplots(1, 3, figsize=(15, 4.8), layout="constrained")
drawn = {"per": "alpha_acceleration", "decibels": True, "marker": "", "jumps": False}
for ax, way in zip(axes[:2], ("up", "down"), strict=True):
    ax.set(xscale="log", title=f"marching {way}, one harmonic")
    for degrees in np.arange(0.5, 10.01, 0.5):
        colour = plt.cm.viridis(degrees / 11)
        marches[way, degrees].plot("C_L", ax=ax, color=colour, **drawn)
        for fold in folds[way, degrees]:
            gain = abs(fold.solution.harmonics("C_L")[1] / fold.solution.harmonics("alpha_acceleration")[1])
            ax.plot(fold.value, 20.0 * np.log10(gain), ".", color=colour, markersize=5.0)
    ax.set(xlim=(0.1, 110.0), ylim=(-50, 60), ylabel=r"$|C_L| \,/\, |\alpha''|$ (dB)")
colours = plt.cm.ScalarMappable(plt.Normalize(0.0, 11.0), "viridis")
figure.colorbar(colours, ax=axes[:2], label=r"$\alpha_2$ (degrees)", ticks=range(1, 11), aspect=40)
where = axes[2]
for way, highest, marker, colour in (("up", 60, "^", "C0"), ("down", 60, "v", "C3"), ("down", 20, "v", "C1")):
    if highest == 60:
        places = [(fold.value, degrees) for (its, degrees), found in folds.items() if its == way for fold in found]
        where.plot(*zip(*places, strict=True), marker, color=colour, fillstyle="none", label=f"{way}, one harmonic")
    chosen, begin = falls[highest][falls[highest]["way"] == way], f" from {highest}" if way == "down" else ""
    where.plot(chosen["falls_at"], chosen["degrees"], marker, color=colour, label=f"{way}{begin}, to a tolerance")
where.set(xscale="log", xlim=(2.0, 70.0), ylim=(0.0, 13.5), yticks=range(0, 11, 2), title="where marches fall")
where.set(xlabel=r"$\omega c/U$", ylabel=r"$\alpha_2$ (degrees)")
where.set_xticks([], minor=True)
where.set_xticks((2, 3, 5, 10, 20, 40, 60), ("2", "3", "5", "10", "20", "40", "60"))
where.legend(fontsize="x-small", loc="upper left", frameon=False, ncols=2)
figure.savefig("figure_3_quasi_linear.png", dpi=110)

# the fold at which the quiet motion ends, both ways, where both marches are on it
quiet_ends = {(row["degrees"], round(row["falls_at"], 3)) for row in falls[20] if row["way"] == "down"}
for degrees, value in ((1.5, 2.978), (2.0, 3.751), (2.5, 4.577), (3.5, 6.362), (4.0, 7.285)):
    assert (degrees, value) in quiet_ends
    assert abs(folds["down", degrees][-1].value - value) < 0.02 * value
