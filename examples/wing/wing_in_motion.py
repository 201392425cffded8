r"""
A wing in motion: shapes over a period, lift and its harmonics
==============================================================

A wing pitches by four degrees about its quarter chord, three degrees nose up in the mean. What shape has its membrane
meanwhile? The displacement is

.. math::

    w(x, t) = \sum_k W_k(t) \sin(k \pi x), \qquad \text{height above the stream} \quad z - \alpha x + w ,

``Solution.plot_shape`` draws the one and, ``in_space``, the other; ``Solution.animate("wing.gif")`` writes the film.

With no incidence in the mean, half a period later the wing is its own mirror image, and the lift has odd harmonics
only. The mean load breaks that: the membrane is tighter while it bulges upward, and the lift has a second harmonic.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp

membrane = hbnlp.QuasiLinearMembrane(mass_ratio=1.0, stiffness=100.0, prestrain=0.01, n_modes=6)
pitch = {"pitch_amplitude": np.radians(4.0), "pitch_mean": np.radians(3.0)}
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(), pitch_axis=0.25, parameters=pitch)
problem = hbnlp.HarmonicBalance(wing, n_harmonics=7)
solution = hbnlp.solve(problem, at={"omega": 1.5})
level = hbnlp.solve(problem, at={"omega": 1.5, "pitch_mean": 0.0})

# %%
# The largest camber of the period, and what the mean incidence does to the second harmonic of the lift:
times = np.linspace(0.0, 2.0 * np.pi / solution.omega, 200)
camber = membrane.camber(solution.displacement(times)).max()
second = {name: float(abs(each.harmonics("C_L")[2])) for name, each in (("3 degrees", solution), ("level", level))}
print(f"camber {camber:.4f} of the chord; second harmonic of C_L: {second}")
assert abs(camber - 0.0387) < 1e-4
assert second["level"] < 1e-12
assert abs(second["3 degrees"] - 0.0456) < 1e-4
assert level.is_odd

# %%
# Shapes in the wing's frame and in space, the lift against its rate, its harmonics.
figure, ((own, space), (phase, bars)) = plt.subplots(2, 2, figsize=(10.0, 7.4), layout="constrained")
solution.plot_shape(ax=own)
solution.plot_shape(in_space=True, ax=space)
solution.plot_phase("C_L", ax=phase, label="3 degrees in the mean")
level.plot_phase("C_L", ax=phase, linestyle=":", label="no incidence in the mean")
phase.set_ylim(top=1.15)  # room for the legend
solution.plot_harmonics("C_L", ax=bars)
figure.savefig("wing_in_motion.png", dpi=110)
