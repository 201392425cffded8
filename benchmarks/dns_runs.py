"""The runs of the flow solver's validation; ``dns_validation.py`` names them and keeps their results."""

from __future__ import annotations

import math
import tempfile
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.linalg

from hbnlp import NonlinearMembrane, dns
from hbnlp.aero import AeroROM, ShortRecordWarning, realise

# three, ten and thirty-three times the base give about 1, 3 and 10
BASE, MULTIPLES = 0.3, np.array([1, 3, 10, 33])
# omega from 0.25 to 30, dense enough for a rational fit, with 2 and its harmonics among them
BAND_BASE = 0.25
BAND_MULTIPLES = np.array([1, 2, 4, 6, 8, 12, 16, 20, 24, 32, 40, 48, 56, 64, 80, 100, 120])
N_MODES = 10
Result = dict[str, object]


def _settings(flow: dns.Simulation) -> Result:
    grid = flow.grid
    return {
        "h": grid.spacing,
        "shape": list(grid.shape),
        "corner": list(grid.corner),
        "levels": grid.levels,
        "dt": flow.dt,
        "reynolds": flow.reynolds,
        "end": flow.time,
    }


def _run(flow: dns.Simulation, until: float, label: str) -> dns.History:
    with dns.ProgressBar(until, label=label) as bar:
        return flow.run(until, callback=bar)


def _wake_length(flow: dns.Simulation, rear: float) -> float:
    """Distance from the rear of the body to where the velocity on the axis turns positive."""
    for level in range(flow.grid.levels):
        h = flow.grid.cell(level)
        x, y = flow.grid.nodes(level)
        middle = int(np.argmin(np.abs(y)))
        u = 1.0 + (flow.psi[level][:, middle + 1] - flow.psi[level][:, middle - 1]) / (2.0 * h)
        turn = np.flatnonzero((u[:-1] < 0.0) & (u[1:] >= 0.0) & (x[:-1] > rear))
        if turn.size:
            i = int(turn[-1])
            return float(x[i] - u[i] * h / (u[i + 1] - u[i]) - rear)
    return math.nan


def cylinder(
    reynolds: float,
    spacing: float,
    until: float,
    *,
    x: tuple[float, float] = (-1.0, 2.0),
    y: tuple[float, float] = (-1.0, 1.0),
    levels: int = 6,
) -> Result:
    """Circular cylinder: mean drag, lift amplitude and Strouhal number over the last cycles, wake length at Re = 40.

    The fine box covers x and y.
    """
    grid = dns.Grid.box(spacing=spacing, x=x, y=y, levels=levels)

    def pulse(t: float) -> tuple[float, float, float]:
        """Brief incidence that starts the shedding."""
        return (0.3 * math.exp(-((t - 3.0) ** 2)) if reynolds > 50.0 else 0.0), 0.0, 0.0

    flow = dns.Simulation(
        grid,
        dns.circle(spacing),
        reynolds=reynolds,
        dt=(0.375 if reynolds < 150.0 else 0.3) * spacing,
        motion=dns.Motion(pitch=pulse),
    )
    history = _run(flow, until, f"cylinder Re = {reynolds:g}")
    late = history.load_time > 0.7 * until
    t, lift, drag = history.load_time[late], history.lift[late], history.drag[late]
    result: Result = {**_settings(flow), "C_D": float(drag[-1])}
    if reynolds < 50.0:
        return {**result, "wake_length": _wake_length(flow, 0.5)}
    up = np.flatnonzero((lift[:-1] < 0.0) & (lift[1:] >= 0.0))
    crossings = t[up] - lift[up] * flow.dt / (lift[up + 1] - lift[up])
    whole = slice(int(up[0]), int(up[-1]))
    return {
        **result,
        "C_D": float(drag[whole].mean()),
        "C_L": float(0.5 * (lift[whole].max() - lift[whole].min())),
        "St": float((crossings.size - 1) / (crossings[-1] - crossings[0])),
        "cycles": int(crossings.size - 1),
    }


def plate(cells: int, levels: int, until: float = 60.0) -> Result:
    """Rigid plate at one degree: drag and lift slope per radian."""
    flow = dns.Simulation(
        dns.Grid.around_plate(cells=cells, levels=levels),
        dns.SharpPlate(),
        dt=0.4 / cells,
        motion=dns.Motion.at_incidence(1.0),
    )
    history = _run(flow, until, f"plate {cells}")
    slope = history.lift / math.radians(1.0)
    early = int(np.searchsorted(history.load_time, until - 5.0))
    return {
        **_settings(flow),
        "C_D": float(history.drag[-1]),
        "lift_slope": float(slope[-1]),
        "change_in_5": float(slope[-1] - slope[early]),
    }


def _steady(cells: int, levels: int) -> dns.Simulation:
    """Rigid plate at zero incidence after 25 c/U, kept between the cases."""
    flow = dns.Simulation(dns.Grid.around_plate(cells=cells, levels=levels), dns.SharpPlate(), dt=0.4 / cells)
    kept = Path(tempfile.gettempdir()) / f"hbnlp_steady_{cells}_{levels}_{flow.grid.spacing:.6f}.npz"
    if kept.exists():
        dns.load_state(flow, kept)
    else:
        _run(flow, 25.0, f"steady {cells}")
        dns.save_state(flow, kept)
    return flow


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
        **_settings(steady),
        "channel": channel,
        "dt_response": dt_factor / cells,
        "omega": column.omega.tolist(),
        "lift": [[z.real, z.imag] for z in column.lift],
        "dCp": [[[z.real, z.imag] for z in row] for row in column.coefficients],
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
    corrected = AeroROM(
        stiffness=rom.stiffness,
        damping=damping,
        mass=impulse - 0.5 * dt * (damping + rom.lag_output @ first),
        lag_state=rom.lag_state,
        lag_input=first,
        lag_output=rom.lag_output,
    )
    omega = BAND_BASE * BAND_MULTIPLES
    values = corrected.transfer(1j * omega)
    return {
        **_settings(steady),
        "duration": duration,
        "n_lags": corrected.n_lags,
        "dropped": realised.dropped,
        "omega": omega.tolist(),
        "columns": {
            str(channel): [[[z.real, z.imag] for z in row] for row in values[:, :, column]]
            for column, channel in enumerate(channels)
        },
    }


def coupled(degrees: float, cells: int, dt_factor: float = 0.4, omega: float = 2.0, periods: int = 8) -> Result:
    """Membrane of the paper's case (mu = 0.5, Eh = 250, delta0 = 0.002), pitching about the leading edge."""
    membrane = NonlinearMembrane(n_modes=N_MODES)
    per_period = math.ceil(2.0 * math.pi / omega * cells / dt_factor)
    dt = 2.0 * math.pi / omega / per_period
    motion = dns.Motion.sinusoidal(omega, pitch=math.radians(degrees))
    grid = dns.Grid.around_plate(cells=cells, levels=6)
    flow = dns.Simulation(grid, dns.Membrane(membrane), dt=dt, motion=motion)
    history = _run(flow, periods * per_period * dt, f"membrane {degrees:g} deg {cells}")
    last, before = slice(-per_period, None), slice(-2 * per_period, -per_period)
    w = np.array([omega])
    lift, earlier = (dns.harmonics(history.load_time[rows], history.lift[rows], w)[0] for rows in (last, before))
    modes = dns.harmonics(history.time[last], history.deflection[last], w)[0]
    return {
        **_settings(flow),
        "degrees": degrees,
        "omega": omega,
        "lift": [lift.real, lift.imag],
        "lift_per_acceleration": abs(lift) / (math.radians(degrees) * omega**2),
        "change_over_last_period": abs(lift - earlier) / abs(lift),
        "W": [[z.real, z.imag] for z in modes],
        "max_strain": float(membrane.elongation(history.deflection[last].T).max()),
        "centrifugal_over_pressure": dns.neglected_inertia(history, motion, membrane.mass_ratio),
    }


@dataclass(frozen=True)
class Chirp:
    """Pitch amplitude sin(phase), the frequency held for some periods, then passing smoothly to the next.

    Parameters
    ----------
    amplitude : float
        Pitch amplitude, rad.
    omegas, periods : tuple
        Frequencies in turn, and how many periods each is held.
    passage : float
        Duration of the passage to the next one.
    """

    amplitude: float
    omegas: tuple[float, ...]
    periods: tuple[int, ...]
    passage: float = 4.0

    def ends(self) -> np.ndarray:
        """Times at which the holds end."""
        holds = 2.0 * math.pi * np.array(self.periods) / np.array(self.omegas)
        return np.cumsum(holds) + self.passage * np.arange(holds.size)

    def phase(self, time: np.ndarray) -> np.ndarray:
        """Phase, its rate and the rate of that, each of the shape of time, in rows."""
        rows = np.zeros((3, *np.shape(time)))
        rows[0], rows[1] = self.omegas[0] * np.asarray(time), self.omegas[0]
        for end, before, after in zip(self.ends(), self.omegas, self.omegas[1:], strict=False):
            r = np.clip((time - end) / self.passage, 0.0, 1.0)
            step = after - before
            rows[0] += step * (
                self.passage * r**4 * (2.5 - 3.0 * r + r**2) + np.maximum(time - end - self.passage, 0.0)
            )
            rows[1] += step * r**3 * (10.0 - 15.0 * r + 6.0 * r**2)
            rows[2] += step * 30.0 * r**2 * (1.0 - r) ** 2 / self.passage
        return rows

    def __call__(self, time: float) -> tuple[float, float, float]:
        """Pitch, rate and acceleration."""
        phase, rate, change = (float(row) for row in self.phase(np.asarray(time)))
        s, c = self.amplitude * math.sin(phase), self.amplitude * math.cos(phase)
        return s, rate * c, change * c - rate**2 * s


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
            history = _run(flow, float(end), label)
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
                "lift": [[z.real, z.imag] for z in lifts[0]],
                "lift_per_acceleration": abs(lifts[0][0]) / (chirp.amplitude * omega**2),
                "change_over_last_period": abs(lifts[0][0] - lifts[1][0]) / abs(lifts[0][0]),
                "W": [[z.real, z.imag] for z in modes[0]],
                "camber": float(np.abs(history.deflection[last] @ x.T).max()),
                "max_strain": float(membrane.elongation(history.deflection[last].T).max()),
                "cpu_seconds": round(time.process_time() - begun, 1),
            }
        )
    return {**_settings(flow), "degrees": math.degrees(chirp.amplitude), "holds": holds, "ended": ended}
