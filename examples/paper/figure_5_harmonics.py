r"""
The paper's harmonics: how many are needed
==========================================

The paper's wing at 2.5 degrees. *Left:* one, three, five and seven harmonics, marched up and down. *Right:* the
frequency from which a quiet motion exists, and the first harmonic of the lift, relative to those with fifteen
harmonics.

The paper says that five harmonics suffice. Up to :math:`\omega = 4` and on the quiet motion they do: lift is then
within 0.02 per cent of that with fifteen, and the onset of the quiet motion within 0.003 per cent. Even harmonics add
nothing to a symmetric motion. On the resonant motion above :math:`\omega = 4` they do not suffice: higher modes
resonate with the fifth and the seventh harmonic, and a march up leaves the resonant motion early, at 4.8 with five
and 9.3 with seven harmonics, where there are folds that move with their number.

Harmonic amplitudes of the lift decrease with their number at :math:`\omega = 1`, sixfold each. Near a resonance of a
higher mode they do not in order: the ninth and eleventh are alike at 4.5.

How many modes are needed is a page of its own (:doc:`modes`). 11 s.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp


def wing(n_modes):
    membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=n_modes)
    return hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=n_modes))


pitch = {"pitch_amplitude": np.radians(2.5)}
ten, omega = wing(10), np.geomspace(0.3, 60.0, 130)
problems = {h: hbnlp.HarmonicBalance(ten, n_harmonics=h) for h in (1, 2, 3, 4, 5, 6, 7, 9, 15)}

marches = {}
for h in (1, 3, 5, 7):
    for way, values in (("up", omega), ("down", omega[::-1])):
        march = marches[h, way] = hbnlp.sweep(problems[h], "omega", values, at=pitch)
        jumps = ", ".join(f"{w:.2f}" for w in march.jump_brackets.mean(axis=1))
        print(f"H = {h} {way:>4}: jumps at omega = {jumps}")

# %%
# Where the quiet motion begins, and the first harmonic of lift on both motions, against the number of harmonics.
print(" H    onset of the quiet motion   |C_L| resonant at 2, 4   quiet at 5.5")
found = {}
for h, problem in problems.items():
    quiet = hbnlp.solve(problem, at={**pitch, "omega": 5.5})
    piece = hbnlp.trace(problem, "omega", (4.0, 5.5), start=quiet, direction=-1, stability=None)
    resonant = [hbnlp.sweep(problem, "omega", np.linspace(0.5, w, 12), at=pitch) for w in (2.0, 4.0)]
    lift = [abs(march.harmonics("C_L")[-1, 1]) for march in resonant] + [abs(quiet.harmonics("C_L")[1])]
    found[h] = np.array([min(fold.value for fold in piece.folds), *lift])
    print(f"{h:2d} {found[h][0]:18.5f} {found[h][1]:18.5f} {found[h][2]:9.5f} {found[h][3]:13.5f}")
assert abs(found[15][0] - 4.57710) < 1e-4
assert np.all(abs(found[5] / found[15] - 1.0) < 3e-4)
np.testing.assert_allclose(found[4], found[3], rtol=1e-7)

# %%
# Amplitudes of the harmonics of lift.
march = hbnlp.sweep(problems[15], "omega", np.linspace(0.5, 4.5, 30), at=pitch)
for i in (4, 12, 19, 26, 29):
    amplitudes = ", ".join(f"{a:.2e}" for a in abs(march.harmonics("C_L")[i, 1:12:2]))
    print(f"omega = {march.parameter[i]:.3f}: |C_L| of the harmonics 1, 3, 5, ...: {amplitudes}")

figure, (left, right) = plt.subplots(1, 2, figsize=(13, 4.8), layout="constrained")
left.set(xscale="log")
for (h, way), march in marches.items():
    style = {"color": {1: "0.6", 3: "C0", 5: "C1", 7: "C3"}[h], "linestyle": "-" if way == "up" else "--", "marker": ""}
    march.plot("C_L", ax=left, per="alpha_acceleration", decibels=True, label=f"H = {h}, {way}", **style)
left.set(title="marching up and down", ylabel=r"$|C_L| \,/\, |\alpha''|$ (dB)", ylim=(-40, 45))
left.legend(fontsize="small")
odd = (1, 3, 5, 7, 9)
for k, label in enumerate(("onset of the quiet motion", "resonant, 2", "resonant, 4", "quiet, 5.5")):
    right.semilogy(odd, [abs(found[h][k] / found[15][k] - 1.0) for h in odd], "o-", label=label)
right.set(xlabel="H", title="relative difference from H = 15")
right.legend()
figure.savefig("figure_5_harmonics.png", dpi=110)
