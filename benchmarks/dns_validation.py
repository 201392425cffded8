"""Fine validation of the flow solver: ``python benchmarks/dns_validation.py [case ...]``.

Each case leaves one small JSON file with its provenance in docs/data/dns; finished cases are skipped, so that an
interrupted campaign goes on where it stopped. Without names it lists the cases; ``all`` runs everything that is
missing, ``tables`` rewrites the tables that docs/dns.md shows.
"""

from __future__ import annotations

import csv
import json
import math
import platform
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import scipy.linalg

from hbnlp import NonlinearMembrane, dns
from hbnlp.aero import AeroROM, ShortRecordWarning, flat_plate_re100, realise

DATA = Path(__file__).parent.parent / "docs" / "data" / "dns"
# nine, eleven and thirty-three times the base give about 1, 3 and 10
BASE, MULTIPLES = 0.3, np.array([1, 3, 10, 33])
# omega from 0.25 to 30, dense enough for a rational fit, with 2 and its harmonics among them
BAND_BASE = 0.25
BAND_MULTIPLES = np.array([1, 2, 4, 6, 8, 12, 16, 20, 24, 32, 40, 48, 56, 64, 80, 100, 120])
N_MODES = 10
# the fine grid is spared the modes beyond the sixth, whose amplitudes are a thousandth of the first one's
BAND_CHANNELS = {25: ("pitch", *range(1, N_MODES + 1)), 50: ("pitch", *range(1, 7))}
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


def cylinder(reynolds: float, spacing: float, until: float) -> Result:
    """Circular cylinder: mean drag, lift amplitude and Strouhal number over the last cycles, wake length at Re = 40."""
    grid = dns.Grid.box(spacing=spacing, levels=6)

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


UP = Chirp(math.radians(2.5), (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), (3, 4, 12, 12, 8, 8))
DOWN = Chirp(math.radians(2.5), (8.0, 6.0, 5.6, 5.3, 5.0, 4.7, 4.0), (10, 8, 14, 12, 10, 12, 14))
CASES: dict[str, Callable[[], Result]] = {
    "cylinder_40": partial(cylinder, 40.0, 0.02, 45.0),
    "cylinder_100": partial(cylinder, 100.0, 0.02, 85.0),
    "cylinder_200": partial(cylinder, 200.0, 0.02, 100.0),
    **{f"plate_{n}": partial(plate, n, 6) for n in (25, 50, 75)},
    **{f"plate_25_levels_{n}": partial(plate, 25, n) for n in (4, 5, 7)},
    **{
        f"response_{channel}_{n}": partial(response, channel, n) for n in (25, 50, 75) for channel in ("pitch", 1, 2, 3)
    },
    **{
        f"band_{channel}_{n}": partial(response, channel, n, base=BAND_BASE, multiples=BAND_MULTIPLES, n_modes=N_MODES)
        for n, channels in BAND_CHANNELS.items()
        for channel in channels
    },
    **{f"coupled_{d}_{n}": partial(coupled, d, n) for n in (25, 50) for d in (0.25, 2.5)},
    **{f"era_{n}": partial(era, n) for n in (25, 50)},
    **{f"march_{way}_{n}": partial(march, chirp, n) for n in (25, 50) for way, chirp in (("up", UP), ("down", DOWN))},
    **{f"march_{way}_25_half_dt": partial(march, chirp, 25, 0.125) for way, chirp in (("up", UP), ("down", DOWN))},
    **{f"coupled_{d}_{n}_half_dt": partial(coupled, d, n, 0.2) for n in (25, 50) for d in (0.25, 2.5)},
}


def run(name: str) -> None:
    """Run one case unless its file is there."""
    path = DATA / f"{name}.json"
    if path.exists():
        return
    begun = time.process_time()
    result = CASES[name]()
    provenance = {
        "case": name,
        "command": f"python benchmarks/dns_validation.py {name}",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "cpu_seconds": round(time.process_time() - begun, 1),
    }
    DATA.mkdir(parents=True, exist_ok=True)
    partial_file = path.with_suffix(".json.part")
    partial_file.write_text(json.dumps({**result, "provenance": provenance}, indent=1) + "\n")
    partial_file.replace(path)


PUBLISHED = {
    40: {"C_D": "1.50-1.54", "wake_length": "2.13-2.35"},
    100: {"C_D": "1.33-1.35", "C_L": ".33-.34", "St": ".164-.166"},
    200: {"C_D": "1.31-1.35", "C_L": ".68-.69", "St": ".192-.197"},
}
Row = list[str]


def _load(prefix: str) -> dict[str, dict[str, Any]]:
    return {path.stem: json.loads(path.read_text()) for path in sorted(DATA.glob(f"{prefix}_*.json"))}


def _complex(pair: list[float]) -> complex:
    return complex(pair[0], pair[1])


def _complexes(pairs: Any) -> np.ndarray:
    array = np.asarray(pairs, dtype=float)
    return array[..., 0] + 1j * array[..., 1]


def _cylinder_rows() -> list[Row]:
    rows = [["Re", "quantity", "computed", "published"]]
    for data in sorted(_load("cylinder").values(), key=lambda item: float(item["reynolds"])):
        for name, published in PUBLISHED[round(data["reynolds"])].items():
            rows.append([f"{data['reynolds']:g}", name, f"{data[name]:.4f}", published])
    return rows


def _plate_rows() -> list[Row]:
    rows = [["h", "levels", "C_D", "lift slope per rad", "change over the last 5 c/U"]]
    rows += [
        [f"{d['h']:.4f}", f"{d['levels']}", f"{d['C_D']:.4f}", f"{d['lift_slope']:.3f}", f"{d['change_in_5']:.3f}"]
        for d in sorted(_load("plate").values(), key=lambda item: (-float(item["h"]), item["levels"]))
    ]
    return rows


def _column(data: dict[str, Any]) -> np.ndarray:
    """Loads [C_L, dCp_1, ...] per unit of the input, a frequency a row."""
    return np.column_stack([_complexes(data["lift"]), _complexes(data["dCp"])])


def _distance(values: np.ndarray, reference: np.ndarray) -> str:
    return f"{100.0 * np.linalg.norm(values - reference) / np.linalg.norm(reference):.1f}"


def _response_rows() -> list[Row]:
    """Every grid, the extrapolation from the two finest and the finite elements, an input and frequency at a time."""
    found: dict[str, dict[float, dict[str, Any]]] = {}
    for data in _load("response").values():
        found.setdefault(str(data["channel"]), {})[data["h"]] = data
    elements = flat_plate_re100(full=True)
    rows = [["input", "omega", "h", "C_L", "dCp_1", "dCp_2", "dCp_3", "difference %", "up to dCp_6 %", "order"]]
    for channel, grids in sorted(found.items()):
        omegas = np.array(next(iter(grids.values()))["omega"])
        index = 0 if channel == "pitch" else int(channel) + 1
        columns = {h: _column(d) for h, d in grids.items()}
        reference = elements.transfer(1j * omegas)[:, : next(iter(columns.values())).shape[1], index]
        spacings = sorted(columns)
        entries = [(f"{h:.4f}", columns[h]) for h in reversed(spacings)]
        orders = [""] * omegas.size
        if len(spacings) > 1:
            fine, coarse = spacings[:2]
            weight = fine / (coarse - fine)
            entries.append(("extrapolated", columns[fine] + weight * (columns[fine] - columns[coarse])))
            errors = [np.linalg.norm((columns[h] - reference)[:, :4], axis=1) for h in (fine, coarse)]
            orders = [f"{order:.2f}" for order in np.log(errors[1] / errors[0]) / math.log(coarse / fine)]
        label = channel if channel == "pitch" else f"W_{channel}"
        for i, omega in enumerate(omegas):
            for name, values in entries:
                loads = [f"{z:.3f}" for z in values[i, :4]]
                errors_here = [_distance(values[i, :n], reference[i, :n]) for n in (4, 7)]
                order = orders[i] if name == f"{spacings[0]:.4f}" else ""
                rows.append([label, f"{omega:.3g}", name, *loads, *errors_here, order])
            finite = [f"{z:.3f}" for z in reference[i, :4]]
            rows.append([label, f"{omega:.3g}", "finite elements", *finite, "", "", ""])
    return rows


def _era_rows() -> list[Row]:
    """Difference of the realised response from the finite elements' and from the measured one of the same grid."""
    elements = flat_plate_re100(full=True)
    rows = [["input", "omega", "h", "from finite elements %", "from the response of the grid %"]]
    for data in sorted(_load("era").values(), key=lambda item: -float(item["h"])):
        cells, omegas = round(1.0 / data["h"]), np.array(data["omega"])
        reference = elements.transfer(1j * omegas)
        for channel in ("pitch", "1", "2", "3"):
            index = 0 if channel == "pitch" else int(channel) + 1
            values = _complexes(data["columns"][channel])
            measured = _column(json.loads((DATA / f"band_{channel}_{cells}.json").read_text()))[:, :4]
            label = channel if channel == "pitch" else f"W_{channel}"
            rows += [
                [label, f"{omega:g}", f"{data['h']:.2f}"]
                + [_distance(values[i], other) for other in (reference[i, :4, index], measured[i])]
                for i, omega in enumerate(omegas)
                if omega in {0.5, 1.0, 3.0, 10.0}
            ]
    return rows


def _coupled_rows() -> list[Row]:
    rows = [
        [
            "alpha_2 (deg)",
            "h",
            "dt",
            "C_L amplitude",
            "C_L / alpha''",
            "W_1",
            "max strain",
            "centrifugal / dCp",
            "CPU s",
        ]
    ]
    rows += [
        [
            f"{d['degrees']:g}",
            f"{d['h']:.3f}",
            f"{d['dt']:.4f}",
            f"{abs(_complex(d['lift'])):.4f}",
            f"{d['lift_per_acceleration']:.3f}",
            f"{abs(_complex(d['W'][0])):.4f}",
            f"{d['max_strain']:.2e}",
            f"{d['centrifugal_over_pressure']:.1e}",
            f"{d['provenance']['cpu_seconds']:.0f}",
        ]
        for d in sorted(
            _load("coupled").values(), key=lambda item: (item["degrees"], -float(item["h"]), -float(item["dt"]))
        )
    ]
    return rows


TABLES = {
    "cylinder": _cylinder_rows,
    "plate": _plate_rows,
    "response": _response_rows,
    "era": _era_rows,
    "coupled": _coupled_rows,
}


def tables() -> None:
    """Write the tables of docs/dns.md from the result files."""
    for name, rows in TABLES.items():
        with (DATA / f"{name}.csv").open("w", newline="") as stream:
            csv.writer(stream, lineterminator="\n").writerows(rows())


def main(arguments: list[str]) -> None:
    """Run the named cases, or list them."""
    if not arguments:
        print("\n".join(CASES))
    elif arguments == ["tables"]:
        tables()
    else:
        for wanted in CASES if arguments == ["all"] else arguments:
            run(wanted)
        tables()


if __name__ == "__main__":
    main(sys.argv[1:])
