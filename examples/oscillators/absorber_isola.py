r"""
A detached branch: oscillator with a nonlinear absorber
=======================================================

A Duffing oscillator carries a small mass :math:`\epsilon` on a tuned spring, damper and cubic spring [1]_:

.. math::

    x_1'' + c_1 x_1' + x_1 + x_1^3 + c_2 (x_1' - x_2') + k_2 (x_1 - x_2) + k_n (x_1 - x_2)^3 &= F \cos \omega t, \\
    \epsilon x_2'' + c_2 (x_2' - x_1') + k_2 (x_2 - x_1) + k_n (x_2 - x_1)^3 &= 0 .

The absorber keeps the resonance of the host small, so it seems: at :math:`F = 0.15` the response that begins at low
frequencies stays below 0.8. But a second branch, an *isola*, floats above it, with motions three times as large. No
sweep in frequency leads there; a knock does.

The isola is found by looking for all solutions at one frequency, and traced round until it closes. The curve of its
folds in the plane of frequency and force tells when it exists: where the force is stationary on that curve, the isola
is *born* as a single point, or *merges* with the main branch.

.. [1] T. Detroux, G. Habib, L. Masset, G. Kerschen, Mech. Syst. Signal Process. 60-61 (2015) 799-809,
   doi:10.1016/j.ymssp.2015.01.035.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp

problem = hbnlp.HarmonicBalance(hbnlp.systems.tuned_absorber(force=0.15), n_harmonics=5)
main = hbnlp.trace(problem, "omega", (0.8, 2.6))
print(main)

# %%
# All solutions at one frequency: the one on the main branch, and two more on the isola.
found = hbnlp.find_all(problem, at={"omega": 1.9})
print("amplitudes at omega = 1.9:", ", ".join(f"{abs(s.harmonics('x1')[1]):.4f}" for s in found))
isola = hbnlp.trace(problem, "omega", (0.8, 2.6), start=found[-1])
print(isola)
assert isola.closed
assert np.allclose(sorted(fold.value for fold in isola.folds), [1.5658235396, 2.3185469325], atol=1e-9)

# %%
# A fold of the isola, followed as the force varies, too: where the detached branch is born, and where it merges.
curve = hbnlp.follow(isola.folds[0], "force", span=(0.08, 0.22))
(birth,), (merge,) = curve.isola_births, curve.isola_merges
print(f"born at F = {birth.second:.9f}, merges at F = {merge.second:.9f}")
assert abs(birth.second - 0.122984738) < 1e-8
assert abs(merge.second - 0.180659229) < 1e-8

figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), layout="constrained")
main.plot("x1", ax=left, label="main branch")
isola.plot("x1", ax=left, label="isola", color="tab:purple")
left.set_title("response at F = 0.15")
curve.plot(ax=right)
right.axhline(0.15, color="0.6", linewidth=0.8, label="force on the left", zorder=0)
right.legend(frameon=False)
right.set(xlabel=r"$\omega$", ylabel="$F$", title="folds in the plane of frequency and force")
figure.savefig("absorber_isola.png", dpi=110)
