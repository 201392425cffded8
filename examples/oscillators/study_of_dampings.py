r"""
Fifty dampings of a beam, by two processes
==========================================

A beam on two pins in 20 modes, stretched by its own bending and shaken at three tenths of its length:

.. math::

    q_k'' + 2 \zeta k^2 q_k' + k^4 q_k + g\, k^2 q_k \sum_m m^2 q_m^2 = F \sin(0.3 \pi k) \cos \omega t,
    \qquad k = 1 \ldots 20,\; g = 0.5,\; F = 0.1.

`hbnlp.study` traces its first resonance at 50 damping ratios, by a pool of two processes, each of which is sent the
problem once. The branches, of which none has as many points as its neighbour, are one Dataset of xarray, labelled by
the damping ratio.

At resonance the force makes up for what the damper takes: :math:`2 \zeta \omega a = F \sin(0.3 \pi)` for the amplitude
a of the first mode, up to the other modes and harmonics. Up to :math:`\zeta = 0.052` the branch folds.
"""

from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import casadi as ca
import numpy as np
from matplotlib import pyplot as plt

import hbnlp

k = np.arange(1.0, 21.0)
beam = hbnlp.System(
    np.eye(20),
    lambda p: 2.0 * p.damping_ratio * ca.DM(np.diag(k**2)),
    np.diag(k**4),
    nonlinear_force=lambda q, v, tau, p: p.stretching * k**2 * q * ca.dot(k**2 * q, q),
    forcing=lambda tau, p: p.force * np.sin(0.3 * np.pi * k) * ca.cos(tau),
    parameters={"damping_ratio": 0.02, "stretching": 0.5, "force": 0.1},
    outputs={"first mode": lambda s: s.q[0]},
    name="beam of 20 modes",
)
problem = hbnlp.HarmonicBalance(beam, n_harmonics=3)
task = partial(hbnlp.trace, problem, "omega", (0.5, 2.2), stability=None)
dampings = np.geomspace(0.01, 0.2, 50)

# %%
# Processes that are spawned import this file; what they are not to do stands behind the question for its name.
if __name__ == "__main__":
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        study = hbnlp.study(task, over={"damping_ratio": dampings}, executor=pool, callbacks=[hbnlp.ProgressBar()])
    print(study)
    table = study.to_xarray()
    amplitude = abs(table.amplitudes.sel(output="first mode", harmonic=1))
    peak = amplitude.max("point")
    omega = table.omega.isel(point=amplitude.argmax("point"))
    balance = 2.0 * table.damping_ratio * omega * peak / (0.1 * np.sin(0.3 * np.pi))
    folding = [damping for damping, branch in zip(dampings, study, strict=True) if branch.folds]
    print(f"the branches fold up to a damping ratio of {max(folding):.4f}; balance {balance.values.min():.4f}")
    assert np.allclose(balance, 1.0, atol=0.02)
    assert 0.051 < max(folding) < 0.054

    figure, ax = plt.subplots(figsize=(7.0, 4.2), layout="constrained")
    colors = plt.get_cmap("viridis")(np.linspace(0.0, 1.0, len(dampings)))
    for i, color in enumerate(colors):
        ax.plot(table.omega[i], amplitude[i], color=color, linewidth=0.9)
    ax.plot(omega, peak, "k.", markersize=3, label="largest amplitude")
    ax.set(xlabel=r"$\omega$", ylabel="amplitude of the first mode", title="damping ratios from 0.01 to 0.2")
    ax.legend(loc="upper left", frameon=False)
    figure.savefig("study_of_dampings.png", dpi=110)
