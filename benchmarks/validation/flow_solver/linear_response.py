"""Linear response of the rigid plate about its steady flow: by small motions, and by steps of velocity."""

from __future__ import annotations

import math
import tempfile
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.linalg
from results import Result, pairs
from running import advance, settings

from hbnlp import dns
from hbnlp.aero import Provenance, ShortRecordWarning, realise

# three, ten and thirty-three times the base give about 1, 3 and 10
BASE, MULTIPLES = 0.3, np.array([1, 3, 10, 33])
# omega from 0.25 to 30, dense enough for a rational fit, with 2 and its harmonics among them
BAND_BASE = 0.25
BAND_MULTIPLES = np.array([1, 2, 4, 6, 8, 12, 16, 20, 24, 32, 40, 48, 56, 64, 80, 100, 120])


def response(
    channel: str | int,
    cells: int,
    levels: int = 6,
    dt_factor: float = 0.4,
    *,
    base: float = BASE,
    multiples: np.ndarray = MULTIPLES,
    n_modes: int = 6,
) -> Result:
    """One column of the linear response by small motions about the steady flow at zero incidence."""
    steady = _steady(cells, levels)
    seconds = 3.0 * math.pi / base + steady.time
    with dns.ProgressBar(seconds, label=f"response {channel} {cells}") as bar:
        column = dns.linear_response(
            steady.grid,
            channel,
            multiples,
            base=base,
            steady=steady.state(),
            dt=dt_factor / cells,
            n_modes=n_modes,
            callback=bar,
        )
    return {
        **settings(steady),
        "channel": channel,
        "dt_response": dt_factor / cells,
        "omega": column.omega.tolist(),
        "lift": pairs(column.lift),
        "dCp": pairs(column.coefficients),
        "drift": column.drift,
    }


def era(cells: int, duration: float = 20.0, n_lags: int = 8) -> Result:
    """Response by the eigensystem realisation of the loads after unit steps of velocity, three modes.

    A step of velocity that the flow solver takes within a time step lies in the middle of it, and the first load after
    it half a step later than the realisation's first sample: the lag states are carried back by a step, the part of the
    transient that falls into the step of the impulse is taken off the impulse, and the half step by which the
    displacement is ahead is taken off the loads.
    """
    n_modes = 3
    steady = _steady(cells, 6)
    dt, channels = 0.4 / cells, ("pitch", "heave", *range(1, n_modes + 1))
    runs = []
    for channel in channels:
        with dns.ProgressBar(steady.time + duration, label=f"step in {channel} {cells}") as bar:
            runs.append(
                dns.step_response(
                    steady.grid, channel, duration, steady=steady.state(), dt=dt, n_modes=n_modes, callback=bar
                )
            )
    loads = np.stack([run.loads for run in runs], axis=2)
    late = runs[0].time >= 0.75 * runs[0].time[-1]
    slopes = np.polyfit(runs[0].time[late], loads[late].reshape(late.sum(), -1), 1)[0].reshape(loads.shape[1:])
    loads -= 0.5 * dt * slopes
    impulse = np.stack([run.impulse for run in runs], axis=1)
    with warnings.catch_warnings():
        # the wake's transient falls as the inverse of time: no record is long enough
        warnings.simplefilter("ignore", ShortRecordWarning)
        realised = realise(runs[0].time - runs[0].time[0], loads, n_lags=n_lags, mass=impulse)
    rom = realised.rom
    first = scipy.linalg.expm(-rom.lag_state * dt) @ rom.lag_input
    damping = rom.damping - dt * rom.stiffness
    corrected = replace(
        rom,
        damping=damping,
        mass=impulse - 0.5 * dt * (damping + rom.lag_output @ first),
        lag_input=first,
        provenance=Provenance(),
    )
    omega = BAND_BASE * BAND_MULTIPLES
    values = corrected.transfer(1j * omega)
    return {
        **settings(steady),
        "duration": duration,
        "n_lags": corrected.n_lags,
        "dropped": realised.dropped,
        "omega": omega.tolist(),
        "columns": {str(channel): pairs(values[:, :, column]) for column, channel in enumerate(channels)},
    }


def _steady(cells: int, levels: int) -> dns.Simulation:
    """Rigid plate at zero incidence after 25 c/U, kept between the cases."""
    flow = dns.Simulation(dns.Grid.around_plate(cells=cells, levels=levels), dns.SharpPlate(), dt=0.4 / cells)
    kept = Path(tempfile.gettempdir()) / f"hbnlp_steady_{cells}_{levels}_{flow.grid.spacing:.6f}.npz"
    if kept.exists():
        dns.load_state(flow, kept)
    else:
        advance(flow, 25.0, f"steady {cells}")
        dns.save_state(flow, kept)
    return flow
