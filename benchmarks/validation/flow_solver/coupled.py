"""Runs of the pitching membrane: at one frequency, and through a list of them with the state carried over."""

from __future__ import annotations

import math
import time

import numpy as np
from chirp import Chirp
from results import Result, pairs
from running import advance, settings

from hbnlp import NonlinearMembrane, dns

N_MODES = 10


def coupled(degrees: float, cells: int, dt_factor: float = 0.4, omega: float = 2.0, periods: int = 8) -> Result:
    """Membrane of the paper's case (mu = 0.5, Eh = 250, delta0 = 0.002), pitching about the leading edge."""
    membrane = NonlinearMembrane(n_modes=N_MODES)
    per_period = math.ceil(2.0 * math.pi / omega * cells / dt_factor)
    dt = 2.0 * math.pi / omega / per_period
    motion = dns.Motion.sinusoidal(omega, pitch=math.radians(degrees))
    grid = dns.Grid.around_plate(cells=cells, levels=6)
    flow = dns.Simulation(grid, dns.Membrane(membrane), dt=dt, motion=motion)
    history = advance(flow, periods * per_period * dt, f"membrane {degrees:g} deg {cells}")
    last, before = slice(-per_period, None), slice(-2 * per_period, -per_period)
    w = np.array([omega])
    lift, earlier = (dns.harmonics(history.load_time[rows], history.lift[rows], w)[0] for rows in (last, before))
    modes = dns.harmonics(history.time[last], history.deflection[last], w)[0]
    return {
        **settings(flow),
        "degrees": degrees,
        "omega": omega,
        "lift": pairs(lift),
        "lift_per_acceleration": abs(lift) / (math.radians(degrees) * omega**2),
        "change_over_last_period": abs(lift - earlier) / abs(lift),
        "W": pairs(modes),
        "max_strain": float(membrane.elongation(history.deflection[last].T).max()),
        "centrifugal_over_pressure": dns.neglected_inertia(history, motion, membrane.mass_ratio),
    }


def march(chirp: Chirp, cells: int, dt_factor: float = 0.25) -> Result:
    """The membrane of `coupled`, the frequency going through a list with the state carried over.

    A run that the flow solver refuses to continue keeps the frequencies finished so far and the reason.
    """
    membrane = NonlinearMembrane(n_modes=N_MODES)
    flow = dns.Simulation(
        dns.Grid.around_plate(cells=cells, levels=6),
        dns.Membrane(membrane),
        dt=dt_factor / cells,
        motion=dns.Motion(pitch=chirp),
    )
    label, ended = f"membrane from omega {chirp.omegas[0]:g} to {chirp.omegas[-1]:g}, {cells}", "as planned"
    x = np.sin(np.pi * np.outer(np.linspace(0.0, 1.0, 101), np.arange(1, N_MODES + 1)))
    holds: list[Result] = []
    for omega, end in zip(chirp.omegas, chirp.ends(), strict=True):
        begun = time.process_time()
        try:
            history = advance(flow, float(end), label)
        except dns.FlowError as error:
            ended = str(error)
            break
        load_phase, phase = chirp.phase(history.load_time)[0], chirp.phase(history.time)[0]
        final = load_phase[-1]
        lifts = []
        for back in (0, 1):
            rows = (load_phase > final - 2.0 * math.pi * (back + 1)) & (load_phase <= final - 2.0 * math.pi * back)
            lifts.append(dns.harmonics(load_phase[rows], history.lift[rows], np.arange(1.0, 8.0)))
        last = phase > phase[-1] - 2.0 * math.pi
        modes = dns.harmonics(phase[last], history.deflection[last], np.arange(1.0, 8.0))
        holds.append(
            {
                "omega": omega,
                "lift": pairs(lifts[0]),
                "lift_per_acceleration": abs(lifts[0][0]) / (chirp.amplitude * omega**2),
                "change_over_last_period": abs(lifts[0][0] - lifts[1][0]) / abs(lifts[0][0]),
                "W": pairs(modes[0]),
                "camber": float(np.abs(history.deflection[last] @ x.T).max()),
                "max_strain": float(membrane.elongation(history.deflection[last].T).max()),
                "cpu_seconds": round(time.process_time() - begun, 1),
            }
        )
    return {**settings(flow), "degrees": math.degrees(chirp.amplitude), "holds": holds, "ended": ended}
