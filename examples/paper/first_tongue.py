r"""
The first tongue, to a tolerance, with both membranes
=====================================================

The folds of the first mode's resonance in pitching frequency and amplitude, followed to a tolerance of 1e-3 with 15
to 37 harmonics and stored (``benchmarks/validation/membrane_wing/first_tongue.py``), beside those of one harmonic.
The tongue begins in a cusp at :math:`(\omega, \alpha_2)` = (2.535, 1.236 degrees), with the full membrane at
(2.539, 1.242).

*An isola.* Between the extrema of its lower edge (square and circle), from 1.200 to 1.288 degrees, with the full
membrane from 1.231 to 1.297, the resonant motion is a loop of its own. The full membrane's lower edge goes on
beyond :math:`\omega = 9.7` through further cusps, one at (6.499, 2.363) among them.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp
from hbnlp.testing import stored_result

membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
problem = hbnlp.HarmonicBalance(wing, n_harmonics=1)
pitch = {"pitch_amplitude": np.radians(2.5)}
fold = min(hbnlp.trace(problem, "omega", (0.5, 60.0), at=pitch, stability=None).folds, key=lambda each: each.value)
curve = hbnlp.follow(fold, "pitch_amplitude", limits=(0.5, 60.0), span=np.radians((0.5, 8.0)))

figure, ax = plt.subplots(figsize=(7, 5), layout="constrained")
curve.plot(ax=ax, color="0.6", linewidth=0.8, label="one harmonic", special=False)
cusps = {}
for name, color in (("quasi_linear", "C0"), ("nonlinear", "C3")):
    path = stored_result(f"wing_tongue_{name}.csv")
    rows = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")
    points, events = rows[rows["event"] == ""], rows[rows["event"] != ""]
    label = "full membrane" if name == "nonlinear" else "quasi-linear membrane"
    ax.plot(points["omega"], np.radians(points["degrees"]), color=color, label=f"{label}, to 1e-3")
    cusp = min(events[events["event"] == "cusp"], key=lambda row: row["omega"])
    cusps[name] = cusp["omega"], cusp["degrees"]
    for kind, marker in (("cusp", "*"), ("isola birth", "o"), ("isola merge", "s")):
        chosen = events[events["event"] == kind]
        ax.plot(chosen["omega"], np.radians(chosen["degrees"]), marker, color=color, markersize=5)
ax.set(xscale="log", yscale="log", xlim=(2.2, 12.0), ylim=np.radians((1.0, 4.0)), ylabel="pitch amplitude (degrees)")
degrees, omegas = (1.0, 1.2, 1.5, 2.0, 3.0, 4.0), (2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
ax.set_yticks(np.radians(degrees), [f"{value:g}" for value in degrees])
ax.set_xticks(omegas, [f"{value:g}" for value in omegas])
ax.set_xticks([], minor=True)
ax.set_yticks([], minor=True)
ax.legend(fontsize="small", loc="upper left")
figure.savefig("first_tongue.png", dpi=110)

assert np.allclose(cusps["quasi_linear"], [2.5351, 1.2362], atol=1e-4)
assert np.allclose(cusps["nonlinear"], [2.5386, 1.2423], atol=1e-4)
