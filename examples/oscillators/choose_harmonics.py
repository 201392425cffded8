r"""
As many harmonics as each point needs
=====================================

How good is a number of harmonics? `hbnlp.truncation_error` estimates it without a better solution to compare with:
the residual in the harmonics beyond the retained ones, answered by one Newton step. *Left:* a strongly forced Duffing
oscillator, the estimate (lines) beside the true error (dots, against 35 harmonics), which it meets within a third
where that is below a tenth. Superharmonic resonances below :math:`\omega = 1` need many harmonics, the main one few.

*Right:* `hbnlp.resolve_harmonics` picks the number point by point along a branch, so that the error stays below a
tolerance, through the folds: for the Duffing oscillator and for the membrane wing of
:doc:`../paper/figure_4_hysteresis`, traced with three harmonics up to a pitching frequency of 4, where higher modes
resonate with the harmonics.
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
    ("Duffing oscillator", hbnlp.HarmonicBalance(duffing, n_harmonics=5), (0.15, 3.0), {}, "C0"),
    ("wing", hbnlp.HarmonicBalance(wing, n_harmonics=3), (0.5, 4.0), {"pitch_amplitude": np.radians(2.5)}, "C1"),
)
for name, problem, span, at, colour in cases:
    branch = hbnlp.trace(problem, "omega", span, at=at, stability=None)
    for tolerance, style in ((1e-2, "--"), (1e-4, "-")):
        resolved = hbnlp.resolve_harmonics(branch, tolerance, at_most=25)
        print(name, repr(resolved))
        label = f"{name}, to {tolerance:g}"
        right.plot(resolved.parameter, resolved.n_harmonics, style, color=colour, drawstyle="steps-mid", label=label)
        assert resolved.reached.all()
right.set(xlabel=r"$\omega$", ylabel="H", title="number of harmonics picked", yticks=range(1, 22, 2))
right.legend()
figure.savefig("choose_harmonics.png", dpi=110)

assert min(r.min() for r in ratios) > 0.6
assert max(r.max() for r in ratios) < 1.5
