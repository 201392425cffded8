r"""
Hysteresis of a Duffing oscillator
==================================

A mass on a spring that stiffens, under a harmonic force:

.. math:: x'' + 2 \zeta x' + x + \gamma x^3 = F \cos \omega t .

With one harmonic of amplitude :math:`A`, :math:`s = \tfrac34 \gamma A^2`, the response is

.. math:: A^2 \left[ (1 + s - \omega^2)^2 + (2 \zeta \omega)^2 \right] = F^2 ,

a resonance whose peak leans over towards higher frequencies: between two *folds* three solutions exist, of which the
middle one is unstable. Here the curve is traced through its folds with seven harmonics, every point with its Floquet
multipliers. Then the equation is integrated in time, the frequency going slowly up and down again, as an experiment
would: the response follows the stable parts, jumps at the folds, and never sees the unstable part.

The parameters are those of the first example of NLvib [1]_; the folds are those of an
independent code, ``tests/numpy_balance.py``.

.. [1] M. Krack, J. Gross, *Harmonic Balance for Nonlinear Vibration Problems*, Springer (2019),
   doi:10.1007/978-3-030-14023-6.
"""

import numpy as np

import hbnlp

system = hbnlp.systems.duffing(damping_ratio=0.025, cubic=0.1, force=0.18)
problem = hbnlp.HarmonicBalance(system, n_harmonics=7)
branch = hbnlp.trace(
    problem, "omega", (0.8, 1.5), method=hbnlp.PseudoArclength(angle=5), callbacks=[hbnlp.ProgressBar()]
)
print(branch)

# %%
# Both folds, located to more digits than are shown, with the sensitivity of each to the parameters: the jump down moves
# up with the force, and down with the damping.
down, up = branch.folds
for fold in (up, down):
    slopes = ", ".join(f"d/d {name} = {slope:+.3f}" for name, slope in fold.sensitivity.items())
    print(f"fold at omega = {fold.value:.10f}, {slopes}")
assert abs(up.value - 1.115700251771) < 1e-8
assert abs(down.value - 1.2696019555) < 1e-8

# %%
# The same equation in time: each frequency starts from the state at which the last one ended.
values = np.linspace(1.0, 1.4, 33)
rising = hbnlp.sweep(system, "omega", values, method=hbnlp.RungeKutta4(), periodic_tol=1e-6)
falling = hbnlp.sweep(system, "omega", values[::-1], method=hbnlp.RungeKutta4(), periodic_tol=1e-6)
assert rising.jump_brackets[0, 0] < down.value < rising.jump_brackets[0, 1]
assert falling.jump_brackets[0, 1] < up.value < falling.jump_brackets[0, 0]

ax = branch.plot("x")
style = {"markersize": 5.0, "markerfacecolor": "none", "linestyle": "none"}
rising.plot("x", ax=ax, label="time integration, up", marker="^", color="tab:orange", **style)
falling.plot("x", ax=ax, label="time integration, down", marker="v", color="tab:green", **style)
ax.set_xlim(0.8, 1.45)
ax.legend(loc="upper left", frameon=False)
ax.figure.savefig("duffing_hysteresis.png", dpi=110)
