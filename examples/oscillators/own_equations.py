r"""
My own equations: period doubling of a pumped oscillator
========================================================

Any forced oscillator is a few lines. Here the spring of a Duffing oscillator is pumped at the frequency of its force,

.. math:: x'' + 2 \zeta x' + (1 + \epsilon \cos \omega t)\, x + \gamma x^3 = F \cos \omega t .

Besides the resonance near :math:`\omega = 1` there is a *parametric* one: near :math:`\omega = 2`, twice the natural
frequency, the response of the period of the force is unstable to a growing oscillation of *twice* that period. For
small motions (:math:`\gamma = F = 0`) this happens within

.. math:: (1 - \omega^2 / 4)^2 + (\zeta \omega)^2 < (\epsilon / 2)^2

(the first tongue of the damped Mathieu equation [1]_). At each end of the unstable interval a Floquet multiplier is
-1: a period doubling. There a branch of subharmonic solutions begins, with harmonics of :math:`\omega/2`. It leaves
the first doubling stably, bends over as a hardening resonance does, and comes back, unstable, to the second.

*Above:* the amplitude at the frequency of the force, of both branches. *Below:* that at half of it, which is zero but
on the branch of twice the period.

.. [1] A. H. Nayfeh, D. T. Mook, *Nonlinear Oscillations*, Wiley (1979), doi:10.1002/9783527617586, chapter 5.
"""

import casadi as ca
import numpy as np
from matplotlib import pyplot as plt

import hbnlp

system = hbnlp.System(
    mass=[[1.0]],
    damping=lambda p: [[2.0 * p.damping_ratio]],
    stiffness=[[1.0]],
    nonlinear_force=lambda q, v, tau, p: [p.pump * ca.cos(tau) * q[0] + p.cubic * q[0] ** 3],
    forcing=lambda tau, p: [p.force * ca.cos(tau)],
    parameters={"damping_ratio": 0.06, "pump": 0.4, "cubic": 1.0, "force": 0.3},
    name="pumped Duffing oscillator",
)
# %%
# All that is connected with the motion from low frequencies: the branch, and that of twice the period between its two
# period doublings. Beyond the second it would come back as its own mirror image, shifted by one period of the force.
problem = hbnlp.HarmonicBalance(system, n_harmonics=5)
diagram = hbnlp.explore(problem, "omega", (0.6, 4.0))
branch, doubled = diagram.branches
print(diagram, branch, doubled, sep="\n")

# %%
# Two ways to the same point: a Floquet multiplier of -1 here, and there the point at which it meets its mirror image.
first, second = branch.of_kind(hbnlp.Kind.PERIOD_DOUBLING)
print(f"period doubling at omega = {second.value:.8f}, multiplier {second.multiplier.real:.8f}")
assert abs(second.value - 2.15617499) < 1e-8
assert doubled.periods == 2
assert abs(second.value - doubled.branch_points[-1].value) < 1e-6

# %%
# And a check of the branch: direct integration from some of its states, over two periods of the force.
stable = [doubled.solution(i) for i in np.flatnonzero(doubled.stable)]
some = [min(stable, key=lambda s: abs(s.omega - omega)) for omega in (1.95, 2.2, 2.6, 3.0, 3.4)]
integrated = [hbnlp.integrate(system, at={"omega": s.omega}, start=s, periods=2).harmonics("x") for s in some]
assert np.allclose(np.abs([x[1] for x in integrated]), [abs(s.harmonics("x")[1]) for s in some], rtol=1e-5)

figure, axes = plt.subplots(2, 1, figsize=(7.0, 7.0), sharex=True, layout="constrained")
diagram.plot("x", ax=axes[0])
doubled.plot("x", ax=axes[1], color="tab:orange", special={hbnlp.Kind.FOLD})
for ax, harmonic, place in zip(axes, (2, 1), ("upper right", "lower right"), strict=True):
    ax.plot([s.omega for s in some], [abs(x[harmonic]) for x in integrated], "kx", label="direct integration")
    ax.legend(frameon=False, loc=place)
axes[0].set_xlabel("")
axes[0].set_title("blue: the period of the force, orange: twice the period")
figure.savefig("own_equations.png", dpi=110)
