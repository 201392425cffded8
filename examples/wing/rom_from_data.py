r"""
A reduced-order model from measured loads: from frequencies, and from steps
===========================================================================

The model of the air about a wing, from the motion :math:`u = [\alpha, z, W_1]` to the loads
:math:`y = [C_L, \Delta C_{p,1}]`,

.. math:: G(s) = K + D s + M s^2 + s^2\, C\, (s I - A)^{-1} B ,

comes from either of two tables (here: thin-aerofoil theory with noise). The first has loads at frequencies, with the
static ones at :math:`\omega = 0`, and is fitted by few poles. The second has loads over time after steps of velocity,
one experiment a motion, :math:`y = K t + D + C e^{A t} B`: eigensystem realisation [1]_.

The added mass :math:`M` acts while the velocity is stepped, and not after it. A step takes some time, here 0.02 chords
over stream velocity, and the mean loads in it are the first row of the table. Their integral is
:math:`M`, but for what the velocity, on its way from 0 to 1, does already: half the loads just after the step.

*Right:* the linear lift response of a membrane with either model: one resonance, its height within a tenth.

.. [1] J.-N. Juang, R. S. Pappa, J. Guidance 8 (1985) 620-627, doi:10.2514/3.20031.
"""

import numpy as np
from matplotlib import pyplot as plt
from scipy.linalg import expm

import hbnlp
from hbnlp import aero
from hbnlp.testing import stored_result

# %%
# From frequencies: the tolerance is the largest error that the data have, 2 per cent.
response = aero.FrequencyResponse.from_csv(
    stored_result("loads_by_frequency.csv"), provenance={"source": "a wind tunnel"}
)
fit = aero.identify(response, tolerance=0.02)
print(fit)

# %%
# From steps: a row a time, loads by motions in the columns; the first row is the mean over the step.
table = np.loadtxt(stored_result("loads_after_steps.csv"), delimiter=",", skiprows=1)
during, time, loads = table[0, 1:].reshape(2, 3), table[1:, 0], table[1:, 1:].reshape(-1, 2, 3)
mass = 0.02 * (during - 0.5 * loads[0])
steps = aero.realise(time, loads, n_lags=2, mass=mass)
print("added mass of heave", mass[0, 1], "of the theory", -np.pi / 2)
print("poles", steps.rom.poles, "singular values", steps.singular_values[:4])

# %%
# Both against the theory, and as models of the air about a membrane.
omega = np.geomspace(0.05, 8.0, 100)
exact = aero.theodorsen_transfer(1j * omega, n_modes=1)
models = {"frequencies": fit.rom, "steps": steps.rom}
for name, rom in models.items():
    errors = np.linalg.norm(rom(1j * omega) - exact, axis=1) / np.linalg.norm(exact, axis=1)
    print(f"from {name}: {rom.n_lags} lag states, within {errors.max():.1%} of the theory")
    assert errors.max() < 0.04
membrane = hbnlp.LinearMembrane(mass_ratio=0.5, n_modes=1)
wings = {name: hbnlp.membrane_wing(membrane, rom) for name, rom in models.items()}
lifts = {name: np.abs(hbnlp.lift_response(wing, omega, tensions=[2.5]).membrane[0]) for name, wing in wings.items()}
peaks = {
    name: (lift[omega > 1.6].max(), omega[omega > 1.6][lift[omega > 1.6].argmax()]) for name, lift in lifts.items()
}
print("height and frequency of the resonance:", peaks)
assert np.allclose(*peaks.values(), rtol=0.1)

figure, (left, middle, right) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
unsteady = np.abs(exact - response.static) / omega[:, None, None]
left.semilogx(omega, unsteady[:, 0, 1], "k", linewidth=3.0, alpha=0.3, label="theory")
left.semilogx(response.omega, np.abs(response.values - response.static)[:, 0, 1] / response.omega, "k.", label="table")
for name, rom in models.items():
    left.semilogx(omega, np.abs(rom(1j * omega) - rom.stiffness)[:, 0, 1] / omega, label=f"from {name}")
    right.loglog(omega, lifts[name], label=f"from {name}")
rom = steps.rom
after = rom.damping + np.array([rom.lag_output @ expm(rom.lag_state * t) @ rom.lag_input for t in time])
for column, motion in enumerate(("pitch", "heave", "first mode")):
    middle.plot(
        time, loads[:, 0, column] - rom.stiffness[0, column] * time, ".", markersize=3, color=f"C{column}", alpha=0.4
    )
    middle.plot(time, after[:, 0, column], color=f"C{column}", linewidth=1.0, label=motion)
left.set(xlabel=r"$\omega$", ylabel=r"$|C_L - C_{L,0}| \,/\, \omega$", title="lift by heave")
for ax in (left, right):
    ax.xaxis.set_major_formatter("{x:g}")
middle.set(xlabel="$t$", ylabel="$C_L - K t$", title="lift after a step of velocity")
right.set(xlabel=r"$\omega$", ylabel=r"$|C_L| \,/\, |\alpha''|$", title="a membrane with either model")
for ax in (left, middle, right):
    ax.legend(frameon=False)
figure.savefig("rom_from_data.png", dpi=110)
