r"""
A tolerance instead of a number of harmonics
============================================

How good is a number of harmonics? `hbnlp.truncation_error` estimates it without a better solution to compare with: each
harmonic beyond the retained ones answers, by its own dynamic stiffness, what they leave over, and the retained ones
answer that. *Left:* a strongly forced Duffing oscillator, the estimate (lines) beside the true error (dots, against 35
harmonics), which it meets within a third where that is below a tenth. Superharmonic resonances below :math:`\omega = 1`
need many harmonics, the main one few.

*Right:* with a tolerance in the place of a number, ``HarmonicBalance(system, tolerance=1e-4)``, each point of a branch
has as many harmonics as its estimated error asks for: the Duffing oscillator, through its folds, and the membrane wing
of :doc:`../paper/figure_4_hysteresis`, whose higher modes resonate with the harmonics. The value of a fold is then as
exact as the motion.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp

duffing = hbnlp.systems.duffing(damping_ratio=0.05, cubic=1.0, force=0.5)
reference = hbnlp.HarmonicBalance(duffing, n_harmonics=35)
figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.6), layout="constrained")
ratios = []
for n_harmonics in (1, 3, 5, 9):
    problem = hbnlp.HarmonicBalance(duffing, n_harmonics=n_harmonics)
    omega, rows = np.linspace(0.3, 1.2, 46), []
    for w in omega:
        exact = hbnlp.solve(reference, at={"omega": w})
        solution = hbnlp.solve(problem, at={"omega": w}, start=exact.coefficients[:, : problem.shape[1]])
        difference = reference.vector(solution.coefficients) - exact.coefficients.ravel()
        true = np.linalg.norm(difference) / np.linalg.norm(solution.coefficients)
        rows.append([hbnlp.truncation_error(solution), true])
    estimates, truths = np.array(rows).T
    line = left.semilogy(omega, estimates, label=f"H = {n_harmonics}")[0]
    left.semilogy(omega, truths, ".", color=line.get_color(), markersize=4)
    known = (truths > 1e-10) & (truths < 0.1)
    ratios.append(estimates[known] / truths[known])
    print(f"H = {n_harmonics}: estimate / true error from {ratios[-1].min():.3f} to {ratios[-1].max():.3f}")
left.set(xlabel=r"$\omega$", title="truncation error: estimate (lines), truth (dots)")
left.legend()

membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
cases = (
    ("Duffing oscillator", duffing, (0.15, 3.0), {}, "C0"),
    ("wing", wing, (0.5, 4.0), {"pitch_amplitude": np.radians(2.5)}, "C1"),
)
for name, system, span, at, colour in cases:
    for tolerance, style in ((1e-2, "--"), (1e-4, "-")):
        problem = hbnlp.HarmonicBalance(system, tolerance=tolerance)
        branch = hbnlp.trace(problem, "omega", span, at=at, stability=None)
        print(branch)
        label = f"{name}, to {tolerance:g}"
        right.plot(branch.parameter, branch.n_harmonics, style, color=colour, drawstyle="steps-pre", label=label)
        assert branch.complete
        assert branch.truncation_error.max() <= tolerance
        for fold, exact in zip(branch.folds, (2.2119353170, 1.4386701455), strict=False):
            assert abs(fold.value - exact) < 0.1 * tolerance
right.set(xlabel=r"$\omega$", ylabel="H", title="number of harmonics of each point", yticks=range(1, 40, 4))
right.legend()
figure.savefig("choose_harmonics.png", dpi=110)

assert min(r.min() for r in ratios) > 0.6
assert max(r.max() for r in ratios) < 1.5
