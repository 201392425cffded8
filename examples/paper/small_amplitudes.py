r"""
Small amplitudes: how fast the response tends to the linear one
===============================================================

Lift per pitching acceleration of the paper's wing, one harmonic, at pitch amplitudes from a hundredth to a sixth of
a degree: the difference from the linear response falls with the square of the amplitude, as the tension's growth
does.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp

membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
problem = hbnlp.HarmonicBalance(wing, n_harmonics=1)
frequencies, small = (0.1, 1.0, 2.0, 6.0), np.array([0.01, 0.02, 0.04, 0.08, 0.16])
linear = hbnlp.lift_response(wing, frequencies, tensions=[1.0]).membrane[0]

figure, ax = plt.subplots(figsize=(6, 4.5), layout="constrained")
for frequency, limit in zip(frequencies, linear, strict=True):
    solutions = [hbnlp.solve(problem, at={"omega": frequency, "pitch_amplitude": np.radians(d)}) for d in small]
    gains = np.array([s.harmonics("C_L")[1] / s.harmonics("alpha_acceleration")[1] for s in solutions])
    differences = abs(gains / limit - 1.0)
    rate = np.polyfit(np.log(small[:3]), np.log(differences[:3]), 1)[0]
    print(f"omega = {frequency:g}: the difference falls with the amplitude to the power {rate:.3f}")
    assert abs(rate - 2.0) < 0.05
    ax.loglog(small, differences, "o-", label=rf"$\omega = {frequency:g}$")
ax.set(xlabel=r"$\alpha_2$ (degrees)", ylabel="difference from the linear response, relative")
ax.legend(frameon=False)
figure.savefig("small_amplitudes.png", dpi=110)
