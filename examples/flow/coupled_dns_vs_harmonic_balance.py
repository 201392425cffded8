r"""
Both branches of the hysteresis in the coupled Navier-Stokes simulation
=======================================================================

The paper's membrane wing (:math:`\mu = 0.5`, :math:`Eh = 250`, :math:`\delta_0 = 0.002`, Re = 100), pitching about its
leading edge through 2.5 degrees. Lines: harmonic balance of the nonlinear membrane with the shipped linear
aerodynamics. Markers: :doc:`the nonlinear flow solver </dns>` coupled with the same membrane, the frequency rising from
1 to 6 (triangles up) or falling from 8 to 4 (triangles down) with the state carried over; each stop lasts several
periods.

At :math:`\omega = 5` the flow settles on either of two motions, depending on where it came from, as the model says;
falling past the model's fold at 4.55 it jumps to the large one. Between 5.8 and 7.3 the model's small motion is
unstable (two Neimark-Sacker points), and there the flow does not settle either: its lift changes from period to period
(crosses; so it does at 8, where the run begins, and the model's small motion is stable again).
Where it settles, lift on the finer grid agrees within three per cent on both branches; on the coarser one the quiet
motion is up to 8 per cent off beside its fold. How much of that is the grid and how much nonlinearity of the flow is in
the tables of :doc:`/dns`.

The runs take minutes (``python benchmarks/validation/flow_solver/run_cases.py march_up_50 march_down_50``) and are read
from files; the branches take seconds.
"""

import json

import numpy as np

import hbnlp
from hbnlp.testing import stored_result

wing = hbnlp.membrane_wing(hbnlp.NonlinearMembrane(), hbnlp.aero.flat_plate_re100())
problem = hbnlp.HarmonicBalance(wing, n_harmonics=7)
pitch = {"pitch_amplitude": np.radians(2.5)}

# %%
# From low frequency the branch of large motions; from high frequency that of small ones, back through its fold.
large = hbnlp.trace(problem, "omega", (0.9, 8.0), at=pitch)
small = hbnlp.trace(problem, "omega", (8.5, 4.0), at=pitch)
print(large, small, sep="\n")

ax = large.plot("C_L", special=False, color="tab:blue", label="harmonic balance, from below")
small.plot("C_L", ax=ax, special=False, color="tab:orange", label="harmonic balance, from above")
for way, marker, colour in (("up", "^", "tab:blue"), ("down", "v", "tab:orange")):
    for cells, face in ((25, "none"), (50, colour)):
        data = json.loads(stored_result(f"march_{way}_{cells}.json").read_text())
        holds, h = data["holds"], data["h"]
        lift = np.array([abs(complex(*hold["lift"][0])) for hold in holds])
        omegas, settled = (np.array([hold[key] for hold in holds]) for key in ("omega", "change_over_last_period"))
        settled = settled < 0.05
        style = {"markerfacecolor": face, "markeredgecolor": colour, "markersize": 8}
        label = f"flow solver, {'rising' if way == 'up' else 'falling'}, h = {h:.2f}"
        ax.plot(omegas[settled], lift[settled], marker, **style, label=label)
        told = "flow solver, modulated" if (way, cells) == ("down", 50) else None
        ax.plot(omegas[~settled], lift[~settled], "x", color="0.3", markersize=6 if cells == 25 else 9, label=told)
        for hold, value in zip(holds, lift, strict=True):
            if hold["change_over_last_period"] > 0.01:
                print(f"omega = {hold['omega']:g}, {way}, h = {h:.2f}: changes by more than a per cent a period")
                continue
            branch = small if way == "down" and hold["omega"] > 4.55 else large
            lifts = [abs(motion.harmonics("C_L")[1]) for motion in branch.at(hold["omega"])]
            difference = value / min(lifts, key=lambda lift, value=value: abs(lift - value)) - 1.0
            print(f"omega = {hold['omega']:g}, {way}, h = {h:.2f}: lift {100 * difference:+.1f} % from the model's")
            # beside the fold the quiet motion is sensitive to the coarser grid's error
            assert abs(difference) < (0.09 if cells == 25 and branch is small else 0.03)

ax.set(yscale="log", xlim=(0.8, 8.2))
ax.legend(frameon=False, fontsize="small")
ax.figure.savefig("coupled_dns_vs_harmonic_balance.png", dpi=110)
