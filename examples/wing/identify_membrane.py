r"""
Identification: stiffness and prestrain from measured lift
==========================================================

The lift amplitude of a pitching membrane wing was measured at ten frequencies, six on the upper and four on the lower
stable branch of its hysteresis loop, with noise (here: synthetic, of a wing whose properties are known). Stiffness
:math:`Eh` and prestrain :math:`\delta_0` follow from one nonlinear program,

.. math::

    \min_{Eh,\, \delta_0,\, x_1 \dots x_{10}} \; \tfrac12 \sum_i \left( a(x_i) - a_i \right)^2
    \quad \text{s.t.} \quad R(x_i; \omega_i, Eh, \delta_0) = 0 ,

in which the ten responses are unknowns as the properties are. Each begins on its own branch of the guessed wing. The
tension at rest, :math:`2 Eh \delta_0`, sets the resonance, and :math:`Eh` how far it leans over, so that both branches
together tell the two apart; nearly so: their errors are strongly correlated.

With the responses eliminated, :math:`J = \partial a / \partial (Eh, \delta_0)`, the covariance of the result is
:math:`\sigma^2 (J^T J)^{-1}` [1]_. It is checked against the scatter of sixty repeated measurements.

.. [1] Y. Bard, *Nonlinear Parameter Estimation*, Academic Press (1974), section 7-5.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp
from hbnlp.design import Variables
from hbnlp.identification import Identification

pitch = {"pitch_amplitude": np.radians(0.5)}
membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.008, n_modes=4)
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.thin_airfoil(n_modes=4), parameters=pitch)
problem = hbnlp.HarmonicBalance(wing, n_harmonics=3)
upper, lower = (3.0, 3.3, 3.6, 3.8, 4.0, 4.1), (4.05, 4.2, 4.4, 4.8)


def on_both_branches(**properties):
    """Return the traced branch, and its points near the measured frequencies: (frequency, solution)."""
    branch = hbnlp.trace(problem, "omega", (2.5, 5.5), at=properties)
    down, up = branch.folds
    parts = ((upper, np.arange(down.index + 1)), (lower, np.arange(up.index + 1, len(branch))))
    near = [(w, part[np.argmin(abs(branch.parameter[part] - w))]) for omegas, part in parts for w in omegas]
    return branch, [({"omega": w}, branch.solution(int(i))) for w, i in near]


# %%
# The measurements: the wing as it is, and noise.
true_branch, near = on_both_branches()
exact = [hbnlp.solve(problem, at={**pitch, **set_to}, start=solution) for set_to, solution in near]
lift = np.array([abs(solution.harmonics("C_L")[1]) for solution in exact])
sigma, rng = 0.01 * lift.mean(), np.random.default_rng(2)
measured = lift + sigma * rng.standard_normal(lift.size)

# %%
# The fit, from a guess that is off by a fifth in stiffness and a third in prestrain.
guess = {"stiffness": 200.0, "prestrain": 0.011}
guessed_branch, points = on_both_branches(**guess)
variables = Variables({"stiffness": (100.0, 500.0), "prestrain": (0.002, 0.03)})
identification = Identification(variables, problem, points, "C_L")
found = identification.fit(measured, guess, noise=sigma)
print(found)
error = np.array(list(found.values.values())) - [250.0, 0.008]
assert error @ np.linalg.solve(found.covariance, error) < 9.2  # 99 per cent of all cases

# %%
# Sixty repetitions of the experiment: do they scatter as the covariance says?
repeated = [identification.fit(lift + sigma * rng.standard_normal(lift.size), found, noise=sigma) for _ in range(60)]
estimates = np.array([list(fit.values.values()) for fit in repeated])
print("scatter", estimates.std(axis=0), "stated", list(found.standard_errors.values()))
assert np.allclose(estimates.std(axis=0) / list(found.standard_errors.values()), 1.0, atol=0.3)

figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), layout="constrained")
fitted_branch = hbnlp.trace(problem, "omega", (2.5, 5.5), at=found.values)
guessed_branch.plot("C_L", ax=left, label="guess", color="0.6", special=False)
fitted_branch.plot("C_L", ax=left, label="identified", special=False)
left.plot(upper + lower, measured, "kx", label="measured")
left.set_title("measurements on both stable branches")
left.legend(frameon=False)
right.plot(*estimates.T, ".", color="0.5", label="repeated experiments")
circle = np.array([np.cos(t := np.linspace(0.0, 2.0 * np.pi, 200)), np.sin(t)])
for radius, style in ((1.0, "-"), (2.0, "--")):
    ellipse = np.array([[250.0], [0.008]]) + radius * np.linalg.cholesky(found.covariance) @ circle
    right.plot(*ellipse, style, color="tab:blue", label=f"{radius:g} $\\sigma$, stated")
right.plot(250.0, 0.008, "k+", markersize=12, label="truth")
right.set(xlabel="$Eh$", ylabel=r"$\delta_0$", title="uncertainty")
right.legend(frameon=False)
figure.savefig("identify_membrane.png", dpi=110)
