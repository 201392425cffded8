r"""
All solutions at a frequency, and the detached branches among them
==================================================================

Does the trace of :doc:`paper_figure_4_hysteresis` show everything? At six frequencies all solutions are searched for:
Newton's method from random starts, deflated by what is known, and continuation in the load (`hbnlp.find_all`, its
default forty starts, seed 1). Those with a deflection below half a chord are compared with the branches traced so
far; a solution on none of them is the start of another branch, which is then traced both ways.

At a pitch amplitude of 2.5 degrees and with one harmonic, the trace from low frequencies holds three solutions inside
its hysteresis interval, and the search finds up to four more: resonances of higher modes, each a detached branch that
begins at a fold of its own (where, the hysteresis map tells: :doc:`paper_hysteresis_map`) and ends at another one far
above (stability is that of the one-harmonic motions). No march in frequency finds them.

*The paper's recipe* for the unstable motion, a rootfinder from random guesses, is tried at :math:`\omega = 6`: of a
hundred guesses, sizes drawn from 0.01 to 1 of the resonant motion's, none ends on the unstable motion; a third end on
the resonant one, most on the quiet one. They cost about as much as twenty traces of the whole branch (without
stability).
"""

import time
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

import hbnlp

membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
problem = hbnlp.HarmonicBalance(wing, n_harmonics=1)
at = {"pitch_amplitude": np.radians(2.5)}
span = (0.5, 150.0)


def solutions_on(branch, omega):
    """Return the coefficients of a branch where it crosses a frequency."""
    places = np.flatnonzero((branch.parameter[:-1] - omega) * (branch.parameter[1:] - omega) <= 0.0)
    found = []
    for i in places:
        share = (omega - branch.parameter[i]) / (branch.parameter[i + 1] - branch.parameter[i])
        guess = branch.coefficients[i] + share * (branch.coefficients[i + 1] - branch.coefficients[i])
        found.append(hbnlp.solve(problem, at={**at, "omega": omega}, guess=guess).coefficients)
    return found


def is_known(solution, branches):
    """Return whether a solution lies on one of the branches."""
    size = np.linalg.norm(solution.coefficients)
    known = [x for branch in branches for x in solutions_on(branch, solution.omega)]
    return any(np.linalg.norm(solution.coefficients - x) < 1e-6 * size for x in known)


attached = hbnlp.trace(problem, "omega", span, at=at)
branches, rng, counts = [attached], np.random.default_rng(1), []
phase = np.linspace(0.0, 2.0 * np.pi, 64)
for omega in (3.0, 6.0, 10.0, 20.0, 30.0, 40.0):
    found = hbnlp.find_all(problem, at={**at, "omega": omega}, rng=rng)
    moderate = [s for s in found if abs(membrane.camber(s.displacement(phase / omega))).max() < 0.5]
    for solution in moderate:
        if not is_known(solution, branches):
            for direction in (1, -1):
                branches.append(hbnlp.trace(problem, "omega", span, start=solution, direction=direction))
                print(f"another branch through omega = {omega:g}: {branches[-1]!r}")
    assert all(is_known(solution, branches) for solution in moderate)
    counts.append(len(moderate))
    print(f"omega = {omega:g}: {len(moderate)} solutions with a camber below 0.5")

# %%
# The recipe of the paper: a rootfinder from random guesses, at one frequency.
at_six = {**at, "omega": 6.0}
resonant, unstable, quiet = sorted(solutions_on(attached, 6.0), key=np.linalg.norm, reverse=True)
size, begun = np.linalg.norm(resonant), time.process_time()
scatter = rng.normal(size=(100, *problem.shape)) * [0.0, 1.0, 1.0]
guesses = [size * 10.0 ** rng.uniform(-2.0, 0.0) * x / 4.0 for x in scatter]
answers = [hbnlp.solve(problem, at=at_six, guess=g, method=hbnlp.Rootfinder(), throw=False) for g in guesses]
reached = [s.coefficients for s in answers if s.converged]
hits = [sum(np.linalg.norm(x - y) < 1e-6 * size for x in reached) for y in (resonant, unstable, quiet)]
print(f"{len(guesses)} random guesses at omega = 6: {hits[0]} resonant, {hits[1]} unstable, {hits[2]} quiet, ", end="")
print(f"{len(guesses) - len(reached)} nothing; {time.process_time() - begun:.2f} CPU s")

figure, ax = plt.subplots(figsize=(9, 5), layout="constrained")
ax.set(xscale="log", title="2.5 degrees, one harmonic: one trace, and what a search adds")
for number, branch in enumerate(branches):
    label = ("from low frequencies", "detached")[number] if number < 2 else None
    drawn = {"color": "C0" if number == 0 else "C1", "special": number == 0}
    branch.plot("C_L", ax=ax, per="alpha_acceleration", decibels=True, label=label, **drawn)
ax.set_ylabel(r"$|C_L| \,/\, |\alpha''|$ (dB)")
Path("figures").mkdir(exist_ok=True)
figure.savefig("figures/paper_all_solutions.png", dpi=110)

assert counts[0] == 1
assert len(branches) > 1
assert hits[0] > 10
assert hits[2] > 10
