r"""
Lift of a pitching membrane wing: a resonance without end
=========================================================

A membrane wing pitches about its leading edge, :math:`\alpha = \alpha_2 \sin \omega t`, in inviscid flow (thin aerofoil
with Jones' lag terms). Its tension at rest is :math:`c_{T0} = 4`, and grows with the square of its camber:

.. math:: 2 \mu W_k'' + k^2 \pi^2 c_T W_k = \Delta C_{p,k} + C_{f,k}, \qquad c_T = 2 Eh (\delta_0 + \delta) .

Drawn is the first harmonic of the lift per pitching acceleration, :math:`|C_L| / |\alpha''|`, for two amplitudes.

*Low frequencies.* The membrane bulges under its load and carries 2.6 dB more lift than the rigid wing at 2.5 degrees,
and 2.1 dB more at 10 degrees, where it has stiffened. The linear response (grey) says 2.7 dB.

*The resonance.* In linear theory the first mode resonates at :math:`\omega = 3.0`. In truth the peak leans over to
higher frequencies so far that it never comes back. The amplitude of a stiffening membrane in free vibration grows with
its frequency, so the load that its damping takes grows as :math:`\omega^2`; but so does the inertial load of a frame
that pitches through a fixed angle. Above about one degree the frame wins at every frequency, and the response stays
resonant to the end of the span, where the linear wing has long become lighter than the rigid one. (In the shaded
part the camber exceeds a tenth of the chord: mathematics only.)

*The other state.* At 2.5 degrees a quiet motion exists as well, from a fold at :math:`\omega = 6.45` on, with 20 dB
less lift. No sweep from low frequencies finds it. Between the two states lies the unstable branch that turns round at
that fold. (Every higher mode adds such branches; they are not drawn.)

*Instabilities.* At 10 degrees, from :math:`\omega = 2.5` to 3.0, symmetric motion is unstable to one with even
harmonics. The small loop near :math:`\omega = 4.5` at 2.5 degrees and the changes of stability at higher frequencies
come from higher modes that meet harmonics of the pitch. They move with the number of harmonics, three here; with five
the fold of the quiet motion moves by 0.1 per cent.
"""

import numpy as np
from matplotlib import pyplot as plt

import hbnlp

membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.008, n_modes=10)
wing = hbnlp.membrane_wing(membrane, hbnlp.aero.thin_airfoil(n_modes=10))
problem = hbnlp.HarmonicBalance(wing, n_harmonics=3)
linear = hbnlp.lift_response(wing, np.geomspace(0.1, 60.0, 600), tensions=[4.0])
drawn = {"per": "alpha_acceleration", "decibels": True, "special": False}

figure, axes = plt.subplots(1, 2, figsize=(11, 4.6), sharey=True, layout="constrained")
for ax, degrees, excess in zip(axes, (2.5, 10.0), (2.61, 2.10), strict=True):
    pitch = {"pitch_amplitude": np.radians(degrees)}
    branch = hbnlp.trace(problem, "omega", (0.1, 60.0), at=pitch, callbacks=[hbnlp.ProgressBar()])
    print(branch)
    ax.set(xscale="log", title=f"pitch amplitude {degrees:g} degrees")
    ax.plot(linear.omega, 20.0 * np.log10(abs(linear.rigid)), ":", color="black", label="rigid wing")
    ax.plot(linear.omega, 20.0 * np.log10(abs(linear.membrane[0])), color="0.6", linewidth=0.9, label="linear membrane")
    branch.plot("C_L", ax=ax, label="from low frequencies", **drawn)

    if degrees == 2.5:
        quiet = hbnlp.solve(problem, at={"omega": 14.0, **pitch})
        detached = hbnlp.trace(problem, "omega", (0.1, 60.0), start=quiet, direction=-1)
        detached.plot("C_L", ax=ax, label="from the quiet motion", **drawn)
        first = min(fold.value for fold in detached.folds)
        print(f"the quiet motion begins at omega = {first:.5f}")
        assert abs(first - 6.446416) < 1e-5
        assert detached.end is hbnlp.End.SPAN_END

    phase = np.linspace(0.0, 2.0 * np.pi, 64)
    camber = [membrane.camber(s.displacement(phase / s.omega)).max() for s in map(branch.solution, range(len(branch)))]
    ax.axvspan(branch.parameter[np.argmax(np.array(camber) > 0.1)], 60.0, color="0.93", zorder=0)
    gain = abs(branch.harmonics("C_L")[:, 1] / branch.harmonics("alpha_acceleration")[:, 1])
    assert abs(20.0 * np.log10(gain[0] / abs(linear.rigid[0])) - excess) < 0.01
    assert branch.end is hbnlp.End.SPAN_END
    assert gain[-1] > 100.0 * abs(linear.membrane[0, -1])

    ax.set_ylabel(r"$|C_L| \,/\, |\alpha''|$ (dB)")

axes[0].set_ylim(-50, 65)
figure.savefig("membrane_wing_inviscid.png", dpi=110)
