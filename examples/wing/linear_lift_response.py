r"""
Linear lift response of membrane wings, and their limits
========================================================

For small motions a membrane wing is a linear system: sine modes of constant tension :math:`c_{T}`, coupled with the
transfer function :math:`G(s)` of the thin aerofoil,

.. math:: (2 \mu s^2 + k^2 \pi^2 c_T) W_k = \Delta C_{p,k} + C_{f,k}, \qquad [C_L, \Delta C_p] = G(s)\, [\alpha, z, W] .

*Left:* lift per pitching acceleration, beside the rigid wing. Well below the first resonance the membrane bulges and
adds lift, the more the slacker it is; each resonance adds a peak, and the inertia of the pitching frame the dips in
between. Above them the membrane stays behind while the wing moves through it, and lift falls below the rigid wing's.

*Right:* where the wing is stable about rest. Below :math:`c_T = 1.726` the stiffness of the air exceeds that of the
membrane, whatever its mass: an eigenvalue is real and positive, and the wing diverges until its camber has raised the
tension. (Infinitely many modes have their limit at 1.727, that of the classical sail equation [1]_.) A membrane more
than 18.7 times as heavy as the air of its chord flutters first: its lowest mode takes energy from the stream.

.. [1] B. Thwaites, Proc. R. Soc. Lond. A 261 (1961) 402-422, doi:10.1098/rspa.1961.0086.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp

membrane = hbnlp.LinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.008, n_modes=10)
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.thin_airfoil(n_modes=10))
response = hbnlp.lift_response(wing, np.geomspace(0.1, 30.0, 300), tensions=[2.0, 4.0, 8.0, 16.0])
print(response)

# %%
# The limits of stability in the prestrain, as tensions c_T = 2 Eh delta0, and the largest growth rate of all above.
limits = {
    (mu, x.kind): 2.0 * 250.0 * x.value
    for mu in (4.0, 18.7, 18.8, 100.0)
    for x in hbnlp.stability_limits(wing, "prestrain", (0.003, 0.04), at={"mass_ratio": mu})
}
divergence = limits[4.0, "divergence"]
print(f"divergence below c_T = {divergence:.6f}, flutter at mu = 100 below c_T = {limits[100.0, 'flutter']:.4f}")
assert np.allclose([limits[mu, "divergence"] for mu in (18.7, 18.8, 100.0)], 1.726336, atol=1e-6)
assert (18.7, "flutter") not in limits
assert (18.8, "flutter") in limits
mass_ratios, tensions = np.geomspace(4.0, 100.0, 81), np.geomspace(divergence + 1e-3, 20.0, 81)
growth = [
    [hbnlp.eigenvalues(wing, {"mass_ratio": mu, "prestrain": c_t / 500.0})[0].real for mu in mass_ratios]
    for c_t in tensions
]

figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), width_ratios=(3, 2), layout="constrained")
response.plot(ax=left).set(ylim=(-50, 65), title="linear lift response")
right.contourf(mass_ratios, tensions, growth, [0.0, np.inf], colors=["C1"], alpha=0.15)
right.contour(mass_ratios, tensions, growth, [0.0], colors=["C1"])
right.axhspan(1.0, divergence, color="C0", alpha=0.15, linewidth=0.0)
right.axhline(divergence, color="C0")
for x, y, what in ((6.0, 6.0, "stable"), (6.0, 1.25, "divergence"), (45.0, 3.0, "flutter")):
    right.text(x, y, what)
right.set(xscale="log", yscale="log", xlim=(4.0, 100.0), ylim=(1.0, 20.0))
right.set(xlabel=r"mass ratio $\mu$", ylabel="$c_T$", title="stability about rest")
figure.savefig("linear_lift_response.png", dpi=110)
