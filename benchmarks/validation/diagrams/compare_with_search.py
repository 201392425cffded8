"""Hold diagrams of four oscillators to what a dense search from random starts finds at ten values each.

The numbers of docs/diagrams.md, "Compared with a search". Run it from the root of the repository, some minutes::

    python benchmarks/validation/diagrams/compare_with_search.py

A motion is missed if no motion of the diagram is the same up to a symmetry of the system. Of a motion over one period
there is one over two periods as well, which is the same.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

import hbnlp


@dataclass(frozen=True)
class Case:
    """An oscillator, what is explored of it, and where it is searched."""

    problem: hbnlp.HarmonicBalance
    span: tuple[float, float]
    searched: tuple[float, float]
    options: Mapping[str, object] = field(default_factory=dict)
    periods: int = 1


def parametron() -> hbnlp.System:
    """Return an oscillator of a stiffness that varies, which leaves rest at twice its frequency and at that."""
    return hbnlp.System(
        [[1.0]],
        [[0.02]],
        [[1.0]],
        nonlinear_force=lambda q, v, tau, p: [0.3 * ca.cos(tau) * q[0] + q[0] ** 3],
        name="parametron",
    )


def cases() -> dict[str, Case]:
    """Return the four by name."""
    duffing = hbnlp.systems.duffing(damping_ratio=0.05, cubic=1.0, force=2.0)
    absorber, chain = hbnlp.systems.tuned_absorber(force=0.15), hbnlp.systems.chain(10)
    return {
        "Duffing at force 2": Case(hbnlp.HarmonicBalance(duffing, 13), (0.3, 4.0), (0.35, 3.5), {"depth": 3}, 2),
        "absorber with an isola": Case(
            hbnlp.HarmonicBalance(absorber, 7), (0.5, 3.0), (1.0, 2.5), {"search_at": [1.8]}
        ),
        "parametron from rest": Case(hbnlp.HarmonicBalance(parametron(), 7), (0.4, 3.0), (0.6, 2.9), {}, 2),
        "ten-mass chain, a budget of 5000 points": Case(
            hbnlp.HarmonicBalance(chain, 3), (2.5, 0.2), (0.4, 2.2), {"max_points": 5000, "stability": None}
        ),
    }


def missed(known: list[hbnlp.Solution], found: hbnlp.SolutionSet) -> list[hbnlp.Solution]:
    """Return the solutions of a search that are none of the motions of a diagram."""
    return [each for each in found if all(hbnlp.relation(each, motion, tol=1e-4) is None for motion in known)]


def main() -> None:
    """Print a line for each value and a table."""
    table = []
    for name, case in cases().items():
        if sys.argv[1:] and not any(word in name for word in sys.argv[1:]):
            continue
        begin = time.process_time()
        diagram = hbnlp.explore(case.problem, "omega", case.span, **case.options)
        seconds = time.process_time() - begin
        print(f"{name}\n{diagram}", flush=True)
        counts = np.zeros(3, dtype=int)
        for number, omega in enumerate(np.linspace(*case.searched, 10)):
            motions, unknown, n_found = [motion.solution for motion in diagram.at(omega)], [], 0
            for periods in range(1, case.periods + 1):
                problem = hbnlp.HarmonicBalance(
                    case.problem.system, periods * case.problem.n_harmonics, periods=periods
                )
                found = hbnlp.find_all(
                    problem,
                    at={"omega": omega},
                    method=hbnlp.Search(n_starts=100),
                    rng=np.random.default_rng(number),
                )
                unknown += missed(motions, found)
                n_found += len(found)
            counts += len(motions), n_found, len(unknown)
            sizes = ", ".join(f"{np.linalg.norm(each.coefficients):.4g}" for each in unknown)
            print(f"  {omega:.4f}: {len(motions)} traced, {n_found} found, {len(unknown)} missed {sizes}", flush=True)
        table.append(f"| {name} | {len(diagram)} | {len(diagram.left)} | {counts[0]} | {counts[1]} | {counts[2]} |")
        print(f"  explored in {seconds:.0f} s of CPU, searched in {time.process_time() - begin - seconds:.0f} s")
    print("| oscillator | branches | left | motions traced | solutions found | missed |", *table, sep="\n")


if __name__ == "__main__":
    main()
