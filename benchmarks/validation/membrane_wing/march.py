"""March the paper's wing at 2.5 degrees by direct integration, so slowly that each motion is left where it ends.

The frequency changed in steps, the state carried over, up from rest at omega = 0.5, down from rest at 70. A step after
which the response differs by more than `CHANGE` is taken back and made half as long, from the state before it, down to
`SHORTEST`; a change that is left then is a jump, unless the response changes as much if it is held where it is: the
wake forgets slowly. So what is found does not hang on the steps: a motion of a small basin is left by long steps, not
by short ones. ``--halved`` makes all of them half as long, as a check.

A response is held for `HOLD` units of time, for `LONGEST` if it still changes after that: modulated motions, and those
that leave slowly. What is kept of it is the mean over a window of `WINDOW` units, in whole periods of the pitch.

The results are ``../results/wing_march_*.csv``: a line a frequency, where ``jump`` is 1 if the motion was left between
the line before and this one. CPU time on one core: some 4 min for each of the quasi-linear membrane's; 12 min for the
full one's up with the Runge-Kutta step compiled to machine code (a CasADi function's ``jit``)::

    python march.py quasi_linear up
    python march.py quasi_linear up --halved

Of the kept marches that of the full membrane up was made with `FEWEST` steps a period, the other three with 128.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Iterator

import numpy as np
from case import MEMBRANES, PITCH, RESULTS, paper_wing

import hbnlp

LOW, HIGH = 0.5, 70.0
LONGEST_STEP, SHORTEST = 0.1, 0.003
"""Relative to the frequency."""
CHANGE, FLOOR = 0.25, 1e-2
"""Of a harmonic of the lift, the largest that one step may make; relative to it and this part of the largest."""
HOLD, LONGEST, WINDOW = 120.0, 240.0, 12.0
SETTLED, SETTLING = 1e-4, 1e-2
"""Changes of the state over a window: the hold is over at the first, and goes on beyond `HOLD` above the second."""
MODULATED = 0.05
"""Lift between the harmonics of the pitch, relative to the largest of them, from which on a response is modulated."""
RATE = 360.0
"""Steps in a unit of time: the fastest lag state decays at a rate of 828, for which the scheme is stable from 300."""
FEWEST = 256
"""Steps a period at least: the ninth harmonic's frequency is right to 2e-5, (h s)^4 / 120. With 142 steps, 2e-4, the
full membrane's march up falls at 15.962, with 567 at 15.968, beyond its fold at 15.967."""
HARMONICS = (1, 2, 3, 5, 7, 9)
COLUMNS = ("omega", *(f"lift_{h}" for h in HARMONICS), "between", "camber", "change", "time", "jump")


class Hold:
    """The response at one frequency."""

    def __init__(self, wing: hbnlp.System, omega: float, state: object, hold: float = HOLD) -> None:
        per_unit = omega / (2.0 * np.pi)
        periods = max(1, round(WINDOW * per_unit))
        self.method = hbnlp.RungeKutta4(steps_per_period=max(FEWEST, int(np.ceil(RATE / per_unit))))
        self.omega, self.time = omega, 0.0
        for limit in (hold, max(hold, LONGEST)):
            response = hbnlp.integrate(
                wing,
                at={"omega": omega, "pitch_amplitude": PITCH},
                start=state,
                method=self.method,
                periods=periods,
                max_periods=max(periods, int((limit - self.time) * per_unit)),
                periodic_tol=SETTLED,
                throw=False,
            )
            state, self.time = response.state, self.time + response.n_periods / per_unit
            self.change = float(response.defects[-1])
            if self.change < SETTLING or self.time >= max(hold, LONGEST) - WINDOW:
                break
        amplitudes = abs(response.harmonics("C_L", 12 * periods))
        self.lift = amplitudes[periods * np.array(HARMONICS)]
        amplitudes[::periods] = 0.0
        self.between = float(np.linalg.norm(amplitudes))
        membrane = hbnlp.LinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=response.q.shape[1])
        self.camber = float(abs(membrane.camber(response.q[:: max(1, len(response.q) // 512)].T)).max())
        self.state = state

    @property
    def modulated(self) -> bool:
        """Whether it does not repeat itself with the pitch."""
        return self.between > MODULATED * float(self.lift.max())

    def whole_difference(self, other: Hold) -> float:
        """Return how far its lift as a whole is from another's."""
        sizes = np.linalg.norm([self.lift, other.lift], axis=1)
        return float(np.linalg.norm(self.lift - other.lift) / sizes.max())

    def difference(self, other: Hold) -> float:
        """Return how far each harmonic of the lift is from another's; of modulated responses, the lift as a whole."""
        if self.modulated or other.modulated:
            return self.whole_difference(other)
        sizes = np.maximum(self.lift, other.lift)
        return float((abs(self.lift - other.lift) / (sizes + FLOOR * sizes.max())).max())

    def row(self, jump: bool) -> list[str]:
        """Return its line of the file."""
        numbers = (*self.lift, self.between, self.camber)
        return [
            f"{self.omega:.6g}",
            *(f"{x:.5e}" for x in numbers),
            f"{self.change:.1e}",
            f"{self.time:.0f}",
            f"{jump:d}",
        ]


def march(wing: hbnlp.System, way: str, scale: float) -> Iterator[tuple[Hold, bool]]:
    """Yield (response, whether it was jumped to), frequency by frequency."""
    sign, end = (1.0, HIGH) if way == "up" else (-1.0, LOW)
    here = Hold(wing, LOW if way == "up" else HIGH, None, 2.0 * LONGEST)
    yield here, False
    step, longest, shortest = LONGEST_STEP * scale, LONGEST_STEP * scale, SHORTEST * scale
    while here.omega != end:
        following = here.omega * (1.0 + step) ** sign
        if sign * (following - end) > -0.3 * step * end:
            following = end
        there = Hold(wing, following, here.state)
        change = there.difference(here)
        if change > CHANGE and step > shortest:
            step = max(step / 2.0, shortest)
            continue
        jump = change > CHANGE and Hold(wing, here.omega, here.state).difference(here) < change / 2.0
        yield there, jump
        here = there
        if change < CHANGE / 2.0:
            step = min(2.0 * step, longest)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("membrane", choices=MEMBRANES)
    parser.add_argument("way", choices=("up", "down"))
    parser.add_argument("--halved", action="store_true", help="steps half as long")
    given = parser.parse_args()
    wing = paper_wing(given.membrane)
    name = f"wing_march_{given.membrane}_{given.way}" + ("_halved" if given.halved else "")
    begun = time.process_time()
    path = RESULTS / f"{name}.csv"
    part = path.with_suffix(".part")
    with part.open("w", newline="") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(COLUMNS)
        for response, jump in march(wing, given.way, 0.5 if given.halved else 1.0):
            row = response.row(jump)
            rows.writerow(row)
            stream.flush()
            sys.stderr.write(f"{time.process_time() - begun:7.1f} s  " + " ".join(row) + "\n")
    part.replace(path)


if __name__ == "__main__":
    main()
