r"""
Design: the prestrain that moves a fold away
============================================

A membrane wing pitching through half a degree has a resonance that leans over: between two folds there are two stable
responses, and the lift depends on how the frequency was reached. *Which is the smallest prestrain* :math:`\delta_0`
*that keeps the first fold above* :math:`\omega = 4.5`, *with a camber of at most 7 per cent?* Tension moves the
resonance to higher frequencies, where the wing is shaken harder and bulges more.

The first fold and the last one, of the largest motion, are unknowns of a nonlinear program beside the prestrain:

.. math::

    \min_{\delta_0,\, x_i,\, v_i,\, \omega_i} \delta_0 \quad \text{s.t.} \quad
    R(x_i, \omega_i; \delta_0) = 0, \quad R_x v_i = 0, \quad v_i^T v_i = 1, \quad
    \omega_1 \ge 4.5, \quad w_2(x, t) \le 0.07 ,

the last at points of the chord and phases of the period, where :math:`w` is linear in the unknowns. IPOPT solves it
with exact derivatives; the multiplier of :math:`\omega_1 \ge 4.5` is the price of frequency,
:math:`d\delta_0 / d\omega_1`. Another objective asks how far the fold can go until the camber is used up. The check is
independent: the new wing is traced from the beginning.
"""

import casadi as ca
import numpy as np
from matplotlib import pyplot as plt

import hbnlp
from hbnlp import design
from hbnlp.fourier import basis_values

membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.008, n_modes=6)
pitch = {"pitch_amplitude": np.radians(0.5)}
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.thin_airfoil(n_modes=6), parameters=pitch)
problem = hbnlp.HarmonicBalance(wing, n_harmonics=3)
before = hbnlp.trace(problem, "omega", (1.0, 8.0))

# %%
# The program: two folds that share the prestrain; the required frequency is data.
shared = design.Variables({"prestrain": (0.004, 0.02)})
last, first = (design.fold_at(problem, shared, fold, "omega") for fold in before.folds)
phases = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
coefficients = ca.reshape(problem.x, problem.shape[1], problem.shape[0]).T
displacement = ca.DM(membrane.shape(np.linspace(0.2, 0.8, 9))) @ coefficients @ ca.DM(basis_values(phases, 3).T)
required = ca.MX.sym("required")
camber = {"camber": (-np.inf, last(displacement), 0.07)}
fold = {"first fold": (0.0, first.symbol("omega") - required, np.inf)}
cost = shared["prestrain"] / 0.008
program = design.Program(shared, [first, last], objective=cost, bounds={**fold, **camber}, data=required, expand=False)
optimum = program.solve({"prestrain": 0.008}, data=4.5)
price = -0.008 * optimum.multipliers["first fold"][0]
print(f"prestrain {optimum.values['prestrain']:.6f}, and {price:.6f} for each further unit of frequency")

# %%
# The independent check: trace the new wing, and look for its first fold.
after = hbnlp.trace(problem, "omega", (1.0, 8.0), at=optimum.values)
print("folds of the new wing at omega =", ", ".join(f"{found.value:.8f}" for found in after.folds))
assert abs(min(found.value for found in after.folds) - 4.5) < 1e-8
assert abs(1.0 / after.folds[1].sensitivity["prestrain"] - price) < 1e-6

# %%
# How far the fold can go, and the prestrain that takes it there.
reach = -first.symbol("omega") / 4.5
farthest = design.Program(shared, [first, last], objective=reach, bounds=camber, expand=False).solve(optimum.values)
limit, largest = (solution.omega for solution in farthest.solutions)
assert abs(membrane.camber(farthest.solutions[1].displacement(phases / largest)).max() - 0.07) < 2e-4
frequencies = np.linspace(before.folds[1].value, limit - 1e-6, 5)
needed = [program.solve({"prestrain": 0.008}, data=omega).values["prestrain"] for omega in frequencies]

figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), layout="constrained")
for branch, value in ((before, 0.008), (after, optimum.values["prestrain"])):
    branch.plot("C_L", ax=left, label=rf"$\delta_0 = {value:.4f}$", per="alpha_acceleration", decibels=True)
left.axvline(4.5, color="0.6", linewidth=0.8)
left.set(ylabel=r"$|C_L| \,/\, |\alpha''|$ (dB)", title="response before and after", xlim=(2.0, 7.0), ylim=(-20, 25))
right.plot(frequencies, needed, "o-", label="smallest prestrain")
right.plot(limit, farthest.values["prestrain"], "*", markersize=12, label="camber of 7 per cent")
right.set(xlabel=r"first fold at $\omega c/U$", ylabel=r"$\delta_0$", title="price of frequency")
right.legend(frameon=False)
figure.savefig("design_prestrain.png", dpi=110)
