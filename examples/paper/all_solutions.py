r"""
All solutions at a frequency, and the detached branches among them
==================================================================

Does one trace from low frequencies show everything? First, at each of its branch points the other branch
is traced as well. Then, at some frequencies, all solutions are searched for: from those on the branches traced so far
and from random starts, by Newton's method deflated by what is known, and by continuation in the load
(`hbnlp.find_all`, its default forty starts, seed 1). A solution with a deflection below half a chord that lies on none
of the branches is listed and becomes the start of another, which is traced both ways.

The pitch amplitude is 2.5 degrees. *Left:* with one harmonic, the trace from low frequencies holds three solutions
inside its hysteresis interval, and the search finds more: resonances of higher modes, each a detached branch that
begins at a fold of its own (where, the hysteresis map tells: :doc:`hysteresis_map`) and ends at another one far
above (stability is that of the one-harmonic motions). A march up does not meet them; one down from rest at a high
frequency can begin on one (:doc:`figure_5_harmonics`).

*Right:* with five harmonics (stability left out) there are asymmetric motions as well, two mirror images each, on
branches that cross the symmetric one at its branch points: six loops, and pieces that leave the span. The search adds
the second mode's tongue, from :math:`\omega = 16.9` on, as with one harmonic.

*The paper's recipe* for the unstable motion, a rootfinder from random guesses, is tried at :math:`\omega = 6` with one
harmonic: of a hundred guesses, sizes drawn from 0.01 to 1 of the resonant motion's, two end on the unstable motion
(none to two with five other seeds), a third on the resonant one, most on the quiet one. They cost about as much as
twenty traces of the whole branch without stability, which passes the unstable motion on its way.
"""

import time

import numpy as np
from matplotlib import pyplot as plt

import hbnlp

membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
at, rng, phase = {"pitch_amplitude": np.radians(2.5)}, np.random.default_rng(1), np.linspace(0.0, 2.0 * np.pi, 64)


def is_among(solution, known):
    size = np.linalg.norm(solution.coefficients)
    return any(np.linalg.norm(solution.coefficients - x.coefficients) < 1e-6 * size for x in known)


def explore(problem, span, frequencies, **options):
    """Return the branches through all moderate solutions that are found, by how, and the number at each frequency."""

    def reached(omega):
        return [solution for branches in found.values() for branch in branches for solution in branch.at(omega)]

    def trace(how, subject, **more):
        found[how].append(hbnlp.trace(subject, "omega", span, **more, **options))
        print(f"{how}: {found[how][-1]!r}")
        return found[how][-1]

    found, counts = {"from low frequencies": [], "from its branch points": [], "by the search": []}, []
    for crossing in trace("from low frequencies", problem, at=at).branch_points:
        for start in hbnlp.switch_branch(crossing):
            if not is_among(start, reached(start.omega)):
                trace("from its branch points", start)
    for omega in frequencies:
        solutions = hbnlp.find_all(problem, at={**at, "omega": omega}, rng=rng, known=reached(omega))
        moderate = [s for s in solutions if abs(membrane.camber(s.displacement(phase / omega))).max() < 0.5]
        for solution in moderate:
            if not is_among(solution, reached(omega)) and not trace("by the search", solution).closed:
                trace("by the search", solution, direction=-1)
        assert all(is_among(solution, reached(omega)) for solution in moderate)
        counts.append(len(moderate))
        print(f"omega = {omega:g}: {len(moderate)} solutions with a camber below 0.5, all on the branches")
    return found, counts


problem = hbnlp.HarmonicBalance(wing, n_harmonics=1)
branches, counts = explore(problem, (0.5, 150.0), (3.0, 6.0, 10.0, 20.0, 30.0, 40.0))
five = hbnlp.HarmonicBalance(wing, n_harmonics=5)
more, counts_of_five = explore(five, (0.5, 60.0), (3.0, 5.0, 8.0, 20.0), stability=None)

# %%
# The recipe of the paper: a rootfinder from random guesses, at one frequency.
at_six, motions = {**at, "omega": 6.0}, branches["from low frequencies"][0].at(6.0)
names = ("resonant", "unstable", "quiet")
motions = sorted(motions, key=lambda s: np.linalg.norm(s.coefficients), reverse=True)
size, begun = np.linalg.norm(motions[0].coefficients), time.process_time()
rng = np.random.default_rng(0)
scatter = rng.normal(size=(100, *problem.shape)) * [0.0, 1.0, 1.0]
guesses = [size * 10.0 ** rng.uniform(-2.0, 0.0) * x / 4.0 for x in scatter]
answers = [hbnlp.solve(problem, at=at_six, start=g, method=hbnlp.Rootfinder(), throw=False) for g in guesses]
reached = [s for s in answers if s.converged]
hits = {name: sum(is_among(s, [motion]) for s in reached) for name, motion in zip(names, motions, strict=True)}
print(f"{len(guesses)} random guesses at omega = 6, {time.process_time() - begun:.2f} CPU s: {hits}")
print(f"{len(guesses) - len(reached)} did not converge")

assert counts[0] == counts_of_five[0] == 1
assert counts_of_five[1] == 3
assert len(branches["by the search"]) > 1
assert sum(branch.closed for branch in more["from its branch points"]) == 6
assert hits["unstable"] < 10 < hits["resonant"]
assert hits["quiet"] > 10

figure, axes = plt.subplots(1, 2, figsize=(13, 5), layout="constrained", sharey=True)
for ax, found, title in ((axes[0], branches, "one harmonic"), (axes[1], more, "five harmonics")):
    ax.set(xscale="log", title=f"2.5 degrees, {title}: one trace, and what else there is")
    for number, (how, group) in enumerate(found.items()):
        for branch in group:
            style = {"color": f"C{number}", "special": number == 0, "label": how if branch is group[0] else None}
            branch.plot("C_L", ax=ax, per="alpha_acceleration", decibels=True, **style)
    ax.set_ylabel(r"$|C_L| \,/\, |\alpha''|$ (dB)")
figure.savefig("all_solutions.png", dpi=110)
