r"""
Sixteen folds: a chain of ten masses
====================================

Ten unit masses on unit springs and weak dampers, each with a cubic spring to the ground, the last one shaken:

.. math::

    x_i'' + d (2 x_i' - x_{i-1}' - x_{i+1}') + 2 x_i - x_{i-1} - x_{i+1} + k_3 x_i^3 = F \delta_{i,10} \cos \omega t,
    \qquad d = 0.02,\; k_3 = 0.5,\; F = 0.1,

with :math:`x_0 = 0` and a free end, :math:`x_{11} = x_{10}`. It is a hard test of a continuation. From
:math:`\omega = 2.5` down to 0.2 the branch turns round sixteen times. It passes dozens of branch points, where another
branch breaks the symmetry :math:`x(t + T/2) = -x(t)` and the determinant of the Jacobian changes its sign without a
fold. Near :math:`\omega = 1.3` its legs come so close that a corrector readily falls from one to another. Here a step
is accepted only if the arc between its ends can be smooth, and is otherwise tried again at half its length (compare
the angle criteria of Allgower and Georg [1]_), so that every leg is passed once.

Seven harmonics make 150 unknowns. All of the high-frequency end is stable, and hardly any of the tangle.

.. [1] E. L. Allgower, K. Georg, *Introduction to Numerical Continuation Methods*, SIAM (2003),
   doi:10.1137/1.9780898719154.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp

problem = hbnlp.HarmonicBalance(hbnlp.systems.chain(10), n_harmonics=7)
branch = hbnlp.trace(problem, "omega", (2.5, 0.2), callbacks=[hbnlp.ProgressBar()])
print(branch)

# %%
# The folds, in the order of the branch, against values of an independent code.
expected = [
    [1.037698837, 1.080013925, 0.786500496, 1.076544718, 0.535510968, 1.295849021, 0.966704292, 1.264666301],
    [0.907068227, 1.291487578, 0.940645927, 1.256394770, 1.068749937, 1.270584141, 0.333995527, 1.965667751],
]
folds = np.array([fold.value for fold in branch.folds])
print(folds.round(6))
assert np.allclose(folds, np.ravel(expected), atol=2e-9)

# %%
# The whole branch, and the tangle where its legs come close.
figure, axes = plt.subplots(1, 2, figsize=(11, 4.4), width_ratios=(3, 2), layout="constrained")
for ax in axes:
    branch.plot("x10", ax=ax, special={hbnlp.Kind.FOLD})
axes[0].set(xlim=(0.2, 2.2), title="sixteen folds")
axes[1].set(xlim=(0.85, 1.33), ylim=(1.3, 2.15), title="where legs come close")
axes[1].get_legend().remove()
figure.savefig("mass_chain.png", dpi=110)
