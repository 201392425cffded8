r"""
The wing for control: state space, poles against tension, describing function
==============================================================================

About rest a membrane wing is linear: with inputs :math:`u`, the accelerations of pitch and heave, and outputs :math:`y`
among them the lift,

.. math:: x' = A x + B u, \qquad y = C x + D u ,

a ``StateSpace`` of python-control, whose frequency response is that of ``hbnlp.lift_response``. The aerodynamic model
goes to python-control and comes back. What the quasi-linear membrane adds to the first mode's stiffness,
:math:`\tfrac12 Eh\, \pi^4\, W_1^3`, has the describing function :math:`\tfrac38 Eh\, \pi^4 A^2`: the stiffness of a
motion of amplitude :math:`A` instead of rest's.

*Middle:* the least damped eigenvalues as the tension falls, of a membrane twenty times as heavy as the air on it. The
first mode's, lowest on the left, are damped the more; the second mode's turn unstable: the wing flutters.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp

membrane = hbnlp.QuasiLinearMembrane(mass_ratio=20.0, stiffness=250.0, prestrain=0.008, n_modes=6)
rom = hbnlp.aero.flat_plate_re100(n_modes=6)
wing = hbnlp.membrane_wing(membrane, rom, pitch_axis=0.25)

# %%
# Both ways: the wing as a state space and as frequency response data, the aerodynamic model there and back.
system = hbnlp.linear_wing(wing)
omega = np.geomspace(0.05, 10.0, 300)
response = hbnlp.lift_response(wing, omega, tensions=[4.0])
lift = np.ravel(system["C_L", "alpha_acceleration"](1j * omega))
assert np.allclose(lift, response.membrane[0], rtol=1e-9)
assert np.allclose(np.ravel(response.to_frd()[0, 0](1j * omega)), response.membrane[0])
back = hbnlp.AeroROM.from_statespace(rom.to_statespace())
assert np.allclose(back(1j * omega), rom(1j * omega), rtol=1e-9)
print(f"{system.nstates} states, inputs {system.input_labels}, outputs {system.output_labels[:3]}, ...")

# %%
# Eigenvalues against the tension, c_T = 2 Eh delta0.
tensions = np.geomspace(0.5, 6.0, 40)
roots = [hbnlp.eigenvalues(wing, at={"prestrain": tension / (2.0 * membrane.stiffness)}) for tension in tensions]
(limit,) = hbnlp.stability_limits(wing, "prestrain", (0.5 / 500.0, 6.0 / 500.0))
flutter = 2.0 * membrane.stiffness * limit.value
print(f"flutter below a tension of {flutter:.4f}: {limit}")
assert all((root.real.max() > 0.0) == (tension < flutter) for root, tension in zip(roots, tensions, strict=True))

# %%
# The describing function of the first mode's hardening, against its closed form.
single = hbnlp.QuasiLinearMembrane(mass_ratio=20.0, stiffness=250.0, prestrain=0.008, n_modes=1)
amplitudes = np.linspace(0.0, 0.1, 41)[1:]
added = hbnlp.describing_function(lambda w, v: 0.5 * single.stiffness * np.pi**4 * w**3, amplitudes).real
assert np.allclose(added, 3.0 / 8.0 * single.stiffness * np.pi**4 * amplitudes**2, rtol=1e-9)

figure, (left, middle, right) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
left.loglog(omega, np.abs(response.membrane[0]), "k", linewidth=3.0, alpha=0.3, label="lift_response")
left.loglog(omega, np.abs(lift), label="state space")
left.set(xlabel=r"$\omega c / U$", ylabel=r"$|C_L| \,/\, |\alpha''|$", title="lift by pitch, $c_T = 4$")
left.xaxis.set_major_formatter("{x:g}")
left.legend(frameon=False)
for tension, root in zip(tensions, roots, strict=True):
    swinging = root[(root.imag > 0.2) & (root.imag < 3.0) & (root.real > -0.3)]
    dots = middle.scatter(
        swinging.real, swinging.imag, c=np.full(len(swinging), tension), s=12, vmin=0.5, vmax=6.0, cmap="viridis"
    )
middle.axvline(0.0, color="0.5", linewidth=0.8)
middle.set(xlabel="growth rate", ylabel="frequency", title=f"eigenvalues; flutter below $c_T$ = {flutter:.2f}")
middle.locator_params(axis="x", nbins=5)
figure.colorbar(dots, ax=middle, label="$c_T$")
right.plot(amplitudes, added / (single.stiffness * 2.0 * single.prestrain * np.pi**2))
right.set(
    xlabel="amplitude $A$ of the first mode", ylabel="added stiffness, of that at rest", title="describing function"
)
figure.savefig("linear_control.png", dpi=110)
