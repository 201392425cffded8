"""Fine validation of the flow solver: ``python benchmarks/validation/flow_solver/run_cases.py [case ...]``.

Each case leaves one small JSON file with its provenance in benchmarks/validation/results; finished cases are skipped,
so that an interrupted campaign goes on where it stopped. Without names it lists the cases; ``all`` runs everything that
is missing. The tables of docs/dns.md are written anew in the end (``write_tables.py``).
"""

from __future__ import annotations

import math
import platform
import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np
import scipy
from chirp import Chirp
from coupled import N_MODES, coupled, march
from linear_response import BAND_BASE, BAND_MULTIPLES, era, response
from results import Result, exists, write
from rigid_bodies import cylinder, plate
from write_tables import write_tables

# the fine grid is spared the modes beyond the fourth: up to omega = 5.6 they stay below two hundredths of the first one
BAND_CHANNELS = {25: ("pitch", *range(1, N_MODES + 1)), 50: ("pitch", *range(1, 5))}
UP = Chirp(math.radians(2.5), (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), (3, 4, 12, 12, 8, 8))
DOWN = Chirp(math.radians(2.5), (8.0, 6.0, 5.6, 5.3, 5.0, 4.7, 4.0), (10, 8, 14, 12, 10, 12, 14))
CASES: dict[str, Callable[[], Result]] = {
    "cylinder_40": partial(cylinder, 40.0, 0.02, 45.0),
    "cylinder_100": partial(cylinder, 100.0, 0.02, 85.0),
    "cylinder_200": partial(cylinder, 200.0, 0.02, 100.0),
    "wake_short_20": partial(cylinder, 200.0, 0.02, 80.0, x=(-0.8, 1.6), y=(-0.8, 0.8), levels=5),
    **{
        f"wake_long_27{name}": partial(cylinder, 200.0, 0.8 / 30, 70.0, x=(-0.8, 4.0), y=(-1.2, 1.2), levels=n)
        for name, n in (("", 5), ("_levels_6", 6))
    },
    "wake_long_20_levels_6": partial(cylinder, 200.0, 0.02, 100.0, x=(-1.0, 4.0), y=(-1.2, 1.2)),
    "wake_long_20_levels_6_re_100": partial(cylinder, 100.0, 0.02, 85.0, x=(-1.0, 4.0), y=(-1.2, 1.2)),
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
    if exists(name):
        return
    begun = time.process_time()
    result = CASES[name]()
    provenance = {
        "case": name,
        "command": f"python benchmarks/validation/flow_solver/run_cases.py {name}",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "cpu_seconds": round(time.process_time() - begun, 1),
    }
    write(name, {**result, "provenance": provenance})


def main(arguments: list[str]) -> None:
    """Run the named cases, or list them."""
    if not arguments:
        print("\n".join(CASES))
        return
    unknown = set(arguments) - {"all", *CASES}
    if unknown:
        sys.exit(f"no case is called {', '.join(sorted(unknown))}; without names the cases are listed")
    for wanted in CASES if arguments == ["all"] else arguments:
        run(wanted)
    write_tables()


if __name__ == "__main__":
    main(sys.argv[1:])
