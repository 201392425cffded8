r"""
The paper's linear lift response, and where the wing is stable
==============================================================

Lift per pitching acceleration of linear membrane wings at Re = 100 (:math:`\mu = 0.5`), tensions :math:`c_T` from 0.5
to 4, and of the rigid wing. The first resonance rises with the tension, in frequency as well as in height above the
rigid wing's lift: from :math:`\omega = 1.15` and 2.5 dB at :math:`c_T = 1` to 3.54 and 12.7 dB at 4. (At 0.5 the
first mode is so strongly damped that it makes no peak.) At low frequencies the membrane bulges and carries more lift,
the more the slacker it is: 3.3 times that of the rigid wing at :math:`c_T = 0.5`, 1.57 at 1, 1.09 at 4; as the
tension grows, the response tends to the rigid wing's.

Unlike in inviscid flow (:doc:`../wing/linear_lift_response`: divergence below :math:`c_T = 1.73`) the wing is stable
about rest at all these tensions. *Right:* it flutters below the line; a heavy membrane does so at larger tensions.
There is no divergence down to :math:`c_T = 0.05`, and a membrane of a mass ratio of 0.05 does not flutter either.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp

membrane = hbnlp.LinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
tensions = np.arange(0.5, 4.01, 0.5)
omega = np.geomspace(0.01, 100.0, 500)
response = hbnlp.lift_response(wing, omega, tensions=tensions)
print(response)

gain, rigid = 20.0 * np.log10(abs(response.membrane)), 20.0 * np.log10(abs(response.rigid))
excess = gain - rigid
peaks = [next(i for i in range(1, omega.size - 1) if g[i] > g[i - 1] and g[i] > g[i + 1]) for g in excess]
low = abs(response.membrane[:, 0] / response.rigid[0])
print("   c_T  resonance  excess (dB)  lift at omega = 0.01, relative to the rigid wing")
for tension, i, g, ratio in zip(tensions, peaks, excess, low, strict=True):
    print(f"{tension:6.1f} {omega[i]:10.3f} {g[i]:12.2f} {ratio:12.4f}")

# %%
# Linear stability about rest: the tension below which the wing flutters or diverges, for light and heavy membranes.
mass_ratios = np.geomspace(0.05, 20.0, 61)
limits = [hbnlp.stability_limits(wing, "prestrain", (1e-4, 0.2), at={"mass_ratio": mu}) for mu in mass_ratios]
highest = np.array([max((500.0 * x.value for x in found), default=np.nan) for found in limits])
kinds = {x.kind for found in limits for x in found}
print(
    "limits:", ", ".join(f"mu = {m:.3g}: {c:.4g}" for m, c in zip(mass_ratios[::4], highest[::4], strict=True)), kinds
)

figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.6), width_ratios=(2, 1), layout="constrained")
response.plot(ax=left).set_title("linear lift response at Re = 100")
right.loglog(mass_ratios, highest, color="C3")
right.fill_between(mass_ratios, 0.02, highest, color="0.92")
right.plot(0.5 * np.ones(8), tensions, "kx", label="the wings on the left")
right.set(
    xlabel=r"mass ratio $\mu$", ylabel="$c_T$", ylim=(0.02, 10.0), xlim=(0.05, 20.0), title="flutter below the line"
)
right.legend(frameon=False, loc="upper left")
figure.savefig("figure_2_linear_lift.png", dpi=110)

assert np.all(response.growth < 0.0)
assert np.all(np.diff(omega[peaks][1:]) > 0.0)
assert np.all(np.diff(excess[np.arange(1, 8), peaks[1:]]) > 0.0)
assert np.all(np.diff(low) < 0.0)
assert low[-1] > 1.0
assert kinds == {"flutter"}
assert np.nanmax(highest) < 1.0
