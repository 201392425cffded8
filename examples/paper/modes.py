r"""
How many sine modes the wing needs
==================================

The paper's membrane has ten sine modes. How far do they stand for the continuous membrane, for which twenty stand here?

*Left:* linear lift at :math:`c_T = 1`. Ten modes are within one per cent of twenty up to :math:`\omega = 9`, and within
ten per cent up to 22: every mode that is left out is a resonance that is missed.

*Right:* the nonlinear response at 2.5 degrees (five harmonics) is content with less, as tension holds the higher modes.
With ten modes, lift on the resonant motion is within 0.04 per cent of that with twenty up to :math:`\omega = 8`, on the
quiet one within 0.3 per cent up to 18, and the onset of the quiet motion (the fold at 4.577) within 0.004 per cent.
Five modes are off by 0.1 and 1.5 per cent. 11 s.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp


def wing(n_modes):
    membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=n_modes)
    return hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=n_modes))


wings, pitch = {n: wing(n) for n in (5, 10, 15, 20)}, {"pitch_amplitude": np.radians(2.5)}

omega = np.geomspace(0.1, 100.0, 200)
linear = {n: hbnlp.lift_response(each, omega, tensions=[1.0]).membrane[0] for n, each in wings.items()}
errors = {n: abs(linear[n] / linear[20] - 1.0) for n in (5, 10, 15)}
for n, error in errors.items():
    limits = ", ".join(f"{e:g}: {omega[np.argmax(error > e)]:.1f}" for e in (0.01, 0.1))
    print(f"N = {n}: linear lift differs from N = 20 by more than ... from omega = ...: {limits}")
assert omega[np.argmax(errors[10] > 0.01)] > 9.0

# %%
# The nonlinear response: both motions, and the fold from which the quiet one exists.
motions = {"resonant": (1.0, 2.0, 3.0, 4.0, 6.0, 8.0), "quiet": (5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 18.0)}
lifts, onsets = {}, {}
for n, each in wings.items():
    problem = hbnlp.HarmonicBalance(each, n_harmonics=5)
    resonant = hbnlp.trace(problem, "omega", (0.5, 18.0), at=pitch, stability=None)
    # the motion that leads from rest as the pitch grows; a cold start may find either
    amplitude = pitch["pitch_amplitude"]
    grown = hbnlp.trace(problem, "pitch_amplitude", (1e-3 * amplitude, amplitude), at={"omega": 5.0}, stability=None)
    middle = grown.solution(len(grown) - 1)
    below, quiet = (
        hbnlp.trace(problem, "omega", (4.0, 18.0), start=middle, direction=d, stability=None) for d in (-1, 1)
    )
    onsets[n] = min(fold.value for fold in below.folds)
    for name, branch, choose in (("resonant", resonant, max), ("quiet", quiet, min)):
        found = [choose(abs(s.harmonics("C_L")[1]) for s in branch.at(w)) for w in motions[name]]
        lifts[name, n] = np.array(found)
    print(
        f"N = {n}: onset of the quiet motion at {onsets[n]:.5f}; |C_L| resonant", lifts["resonant", n].round(5), end=""
    )
    print(", quiet", lifts["quiet", n].round(5))
assert np.all(abs(lifts["resonant", 10] / lifts["resonant", 20] - 1.0) < 5e-4)
assert np.all(abs(lifts["quiet", 10] / lifts["quiet", 20] - 1.0) < 3.5e-3)
assert abs(onsets[10] / onsets[20] - 1.0) < 5e-5

figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.6), layout="constrained")
for n, error in errors.items():
    left.loglog(omega, error, label=f"{n} modes")
left.set(xlabel=r"$\omega c/U$", title="linear lift: relative difference from twenty modes", ylim=(1e-6, 3.0))
left.legend()
for name, marker in (("resonant", "o-"), ("quiet", "s--")):
    for k, n in enumerate((5, 10, 15)):
        error = abs(lifts[name, n] / lifts[name, 20] - 1.0)
        right.loglog(motions[name], error, marker, color=f"C{k}", markersize=4, label=f"{name}, {n} modes")
right.set(xlabel=r"$\omega c/U$", title="nonlinear lift at 2.5 degrees: the same", ylim=(1e-6, 3.0))
right.legend(fontsize="small")
figure.savefig("modes.png", dpi=110)
