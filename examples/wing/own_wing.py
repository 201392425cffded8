r"""
A wing of one's own: response, motion, map, table, and a fit to measured lift
=============================================================================

What a designer asks of one wing, from its numbers to its files: :math:`\mu = 1`, :math:`Eh = 100`, :math:`\delta_0
= 0.01`, pitched by four degrees about its quarter chord, three degrees nose up in the mean, at a chord Reynolds
number of 100. :doc:`../../my_own_wing` says what each number is; its reduced model may be another one, from a table
or from steps (:doc:`rom_from_data`).

*Upper left:* the response to a tolerance. Besides the resonant motion there is a quiet one, from a fold at
:math:`\omega = 3.46` on, which no trace from low frequencies meets: `hbnlp.explore` finds it. Shaded is what
exceeds the limits of `wing.validity`. *Upper right:* that fold in frequency and amplitude, with five harmonics: it
begins in a cusp, below which there is one motion alone. *Below:* the lift of both motions over a period, and the
stiffness and prestrain that come back from a table of lift, measured at rising frequencies, with noise of one per
cent.
"""

import csv
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

import hbnlp
from hbnlp.design import Variables
from hbnlp.identification import Measurements, identify

numbers = {"mass_ratio": 1.0, "stiffness": 100.0, "prestrain": 0.01}
membrane = hbnlp.QuasiLinearMembrane(**numbers, n_modes=6)
incidence = {"pitch_mean": np.radians(3.0), "pitch_amplitude": np.radians(4.0)}
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(), pitch_axis=0.25, parameters=incidence)
problem = hbnlp.HarmonicBalance(wing, tolerance=1e-3)

# %%
# All motions from 0.2 to 8, and those at one frequency; the table, and the film of the resonant motion.
diagram = hbnlp.explore(problem, "omega", (0.2, 8.0))
print(diagram)
print(*diagram.intervals(), sep="\n")
there = sorted(diagram.at(4.0), key=lambda motion: -abs(motion.solution.harmonics("C_L")[1]))
resonant, quiet = (motion.solution for motion in there if motion.stable)
diagram.to_dataframe().to_csv("own_wing.csv")
resonant.animate("own_wing.gif", in_space=True)

# %%
# The map of the fold at which the quiet motion begins.
few = hbnlp.HarmonicBalance(wing, n_harmonics=5)
begin = hbnlp.solve(few, at={"omega": 4.0}, start=quiet)
fold = hbnlp.trace(begin, "omega", (4.0, 3.0)).folds[0]
curve = hbnlp.follow(fold, "pitch_amplitude", limits=(0.5, 8.0), span=np.radians((1.0, 8.0)))
(cusp,) = curve.cusps
print(f"with five harmonics: {fold}, from a cusp at omega = {cusp.first:.3f}, {np.degrees(cusp.second):.2f} degrees on")

# %%
# A table of measured lift, here of the wing itself with noise, and what it tells of the membrane.
rng = np.random.default_rng(5)
with Path("own_sweep.csv").open("w", newline="") as stream:
    rows = csv.writer(stream)
    rows.writerow(["omega", "lift"])
    for omega in np.linspace(0.6, 4.0, 12):
        lift = max(abs(motion.solution.harmonics("C_L")[1]) for motion in diagram.at(omega))
        rows.writerow([f"{omega:.4f}", f"{lift * (1.0 + 0.01 * rng.standard_normal()):.5f}"])
measured = Measurements.from_csv("own_sweep.csv", omega="omega", amplitude="lift")
variables = Variables({"stiffness": (40.0, 250.0), "prestrain": (0.002, 0.03)})
starts = [{"stiffness": 80.0, "prestrain": 0.008}, {"stiffness": 130.0, "prestrain": 0.012}]
fit = identify(
    hbnlp.HarmonicBalance(wing, n_harmonics=3),
    variables,
    measured,
    "C_L",
    start=starts,
    weights=1.0 / measured.amplitude**2,
)
print(fit)

figure, ((response, plane), (signals, fitted)) = plt.subplots(2, 2, figsize=(11.0, 8.0), layout="constrained")
diagram.plot("C_L", ax=response, validity=[wing.validity(branch) for branch in diagram.branches])
curve.plot(ax=plane)
plane.axhline(np.radians(4.0), color="0.5", linewidth=0.6, linestyle=":")
ticks = np.arange(2.0, 9.0)
plane.set_yticks(np.radians(ticks), [f"{degrees:g}" for degrees in ticks])
plane.set_ylabel("pitch amplitude (degrees)")
resonant.plot("C_L", ax=signals, label="resonant")
quiet.plot("C_L", ax=signals, label="quiet")
signals.legend(frameon=False)
fit.branch.plot("C_L", ax=fitted, label="fitted")
fitted.plot(measured.omega, measured.amplitude, "kx", label="measured")
fitted.set(xlim=(0.4, 4.4), ylim=(0.0, 1.25 * measured.amplitude.max()))
fitted.legend(frameon=False)
figure.savefig("own_wing.png", dpi=110)

assert np.degrees(cusp.second) < 2.5
(quiet_begins,) = (junction.point for junction in diagram.special_points if junction.point.kind is hbnlp.Kind.FOLD)
assert abs(quiet_begins.multiplier - 1.0) < 1e-4
error = np.array([fit.values[name] - numbers[name] for name in variables.names])
assert error @ np.linalg.solve(fit.identified.covariance, error) < 9.2  # 99 per cent of all cases
