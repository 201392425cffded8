"""Hold random forced oscillators to what must be true of each: how many checks were made, and what failed.

The systems are `tests/random_oscillators.py`, the checks `tests/invariants.py`. Run it from the repository's root::

    python benchmarks/random_systems.py --count 1000 --seed 0    # seeds 0 to 999
    python benchmarks/random_systems.py --count 1 --seed 17      # one of them again

A failure is told as it comes and the run goes on; each system is a line of JSON in the file of --out.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import contextlib
import json
import logging
import sys
import time
from collections import Counter
from pathlib import Path

from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from invariants import Report, examine
from random_oscillators import RandomOscillator


def examined(seed: int) -> tuple[RandomOscillator, Report]:
    """Examine the system of a seed; an error that is raised before any check is a failure as well."""
    oscillator = RandomOscillator.of(seed)
    try:
        return oscillator, examine(oscillator)
    except Exception as error:  # noqa: BLE001 (the run goes on, and tells)
        return oscillator, Report(failures=[("error", f"{type(error).__name__}: {error}"[:300])])


def run(first: int, count: int, out: Path | None) -> list[Report]:
    """Examine one seed after another; Ctrl-C ends the run with what there is."""
    reports: list[Report] = []
    with contextlib.suppress(KeyboardInterrupt), tqdm(total=count, unit="system", disable=count == 1) as bar:
        for seed in range(first, first + count):
            begin = time.process_time()
            oscillator, report = examined(seed)
            reports.append(report)
            for kind, what in report.failures:
                bar.write(f"{oscillator}\n    {kind}: {what}")
            if out is not None:
                seconds = round(time.process_time() - begin, 2)
                with out.open("a") as file:
                    file.write(json.dumps({"seed": seed, "seconds": seconds, **vars(report)}) + "\n")
            bar.update()
    return reports


def print_table(reports: list[Report]) -> None:
    checks, failures, left_out = Counter(), Counter(), Counter()
    for report in reports:
        checks.update(report.checks)
        left_out.update(report.left_out)
        failures.update(kind for kind, _ in report.failures)
    points, failed = sum(r.points for r in reports), sum(bool(r.failures) for r in reports)
    print(f"{len(reports)} systems, {points} points, {failed} systems with a failure")
    print(f"{'check':<24}{'made':>8}{'failed':>8}")
    for kind in sorted(checks.keys() | failures.keys()):
        print(f"{kind:<24}{checks[kind]:>8}{failures[kind]:>8}")
    for kind, number in sorted(left_out.items()):
        print(f"left out, {kind}: {number}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000, help="number of systems")
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--out", type=Path, help="file to which each system's result is appended as it is there")
    given = parser.parse_args()
    logging.getLogger("hbnlp").setLevel(logging.ERROR)  # traces that are cut short on purpose
    reports = run(given.seed, given.count, given.out)
    print_table(reports)
    sys.exit(any(report.failures for report in reports))


if __name__ == "__main__":
    main()
