r"""
From a table of measured lift to stiffness and prestrain
========================================================

A membrane wing was pitched at rising and falling frequencies, and the amplitude of its lift written down (here: a
synthetic table, with noise and two wrong rows). Nothing says on which of the two stable branches of the hysteresis loop
a row lies, nor which rows are wrong. Both are found together with stiffness :math:`Eh` and prestrain :math:`\delta_0`,
in rounds: the branch is traced, each row given to the stable part that it lies nearest to, and the values fitted by

.. math::

    \min_{Eh,\, \delta_0,\, x_i} \; \tfrac12 \sum_i w_i \left( a(x_i) - a_i \right)^2
    \quad \text{s.t.} \quad R(x_i; \omega_i, Eh, \delta_0) = 0 ,

with weights :math:`w_i` of the soft l1 loss first, then none for rows that are four standard deviations off [1]_.

.. [1] P. J. Rousseeuw, A. M. Leroy, *Robust Regression and Outlier Detection*, Wiley (1987), section 1.2.
"""

import numpy as np

import hbnlp
from hbnlp.design import Variables
from hbnlp.identification import Measurements, identify
from hbnlp.testing import stored_result

membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=200.0, prestrain=0.011, n_modes=4)
pitch = {"pitch_amplitude": np.radians(0.5)}
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.thin_airfoil(n_modes=4), parameters=pitch)
problem = hbnlp.HarmonicBalance(wing, n_harmonics=3)

# %%
# The frequencies are in Hz; the equations have times in chord / velocity, 0.1 m / (10 m/s).
measured = Measurements.from_csv(
    stored_result("measured_lift.csv"), omega="f [Hz]", amplitude="C_L", omega_unit=2.0 * np.pi * 0.1 / 10.0
)
print(measured)

# %%
# From a guess that is off by a fifth in stiffness and a third in prestrain.
variables = Variables({"stiffness": (100.0, 500.0), "prestrain": (0.002, 0.03)})
fit = identify(problem, variables, measured, "C_L", start={"stiffness": 200.0, "prestrain": 0.011})
print(fit)
for name, (low, high) in fit.confidence(0.95).items():
    print(f"{name} from {low:.5g} to {high:.5g} with a probability of 95 per cent")
assert [measured.lines[k] for k in fit.wrong] == [6, 21]
error = np.array([fit.values["stiffness"] - 250.0, fit.values["prestrain"] - 0.008])
assert error @ np.linalg.solve(fit.identified.covariance, error) < 9.2  # 99 per cent of all cases

figure = fit.plot()
figure.savefig("identify_from_table.png", dpi=110)
