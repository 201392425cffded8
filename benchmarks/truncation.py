"""How right the estimated error of truncation is: beside the true one, along branches of several systems.

Each system is traced with a few numbers of harmonics. At points of the branches the estimate, of which the tolerance of
a `HarmonicBalance` is a bound, is set beside the distance to the solution with many harmonics; both are taken in the
plane normal to the branch, so that folds count, and relative to the size of the whole solution. Errors beyond a tenth
or below 1e-10 are left out. Run it from the root of the repository; a word runs the cases that hold it::

    python benchmarks/truncation.py
    python benchmarks/truncation.py wing
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import logging
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

import hbnlp
from hbnlp.continuation.curve import Bordered
from hbnlp.continuation.newton import Newton, correct
from hbnlp.core.types import Array
from hbnlp.solutions.equations import Equations, along_parameter
from hbnlp.solutions.truncation import Estimate

LARGEST, SMALLEST = 0.1, 1e-10
POINTS = 40
"""Points of a branch that are looked at."""
METHOD = hbnlp.PseudoArclength(max_points=600)


@dataclass(frozen=True)
class Case:
    """A system, the numbers of harmonics with which it is traced, and how many are taken for the truth."""

    name: str
    system: hbnlp.System
    numbers: tuple[int, ...]
    many: int
    span: tuple[float, float]
    at: dict[str, float] = field(default_factory=dict)
    start: Callable[[hbnlp.HarmonicBalance], hbnlp.Solution] | None = None


def own(force: Callable[..., list[ca.SX]], damping: float) -> hbnlp.System:
    """Return an oscillator x'' + c x' + x + f(x, x') = F cos(omega t)."""
    return hbnlp.System(
        1.0,
        damping,
        1.0,
        nonlinear_force=force,
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"force": 0.4},
    )


def contact(q: ca.SX, _v: ca.SX, _tau: ca.SX, _p: object) -> list[ca.SX]:
    """Return the force of a spring beyond a gap of 0.5, its corner rounded over 0.1."""
    return [(q[0] - 0.5) + ca.sqrt((q[0] - 0.5) ** 2 + 0.1**2)]


def wing(membrane: hbnlp.wing.membrane.Membrane) -> hbnlp.System:
    """Return a wing on the shipped aerodynamics."""
    return hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=membrane.n_modes))


def on_the_isola(problem: hbnlp.HarmonicBalance) -> hbnlp.Solution:
    """Return the largest solution of the absorber in the middle of its isola."""
    found = hbnlp.find_all(problem, at={"omega": 1.8}, method=hbnlp.Search(n_starts=20))
    return max(found, key=lambda solution: abs(solution.harmonics("x1")[1]))


def cases() -> Iterator[Case]:
    """Yield all cases."""
    strong = hbnlp.systems.duffing(damping_ratio=0.05, cubic=1.0, force=0.5)
    yield Case("Duffing, weakly forced", hbnlp.systems.duffing(), (1, 3, 5), 25, (0.3, 3.0))
    yield Case("Duffing, strongly forced", strong, (1, 3, 5, 7), 35, (0.15, 3.0))
    yield Case("absorber", hbnlp.systems.tuned_absorber(), (1, 3, 5), 25, (0.8, 2.6))
    yield Case("absorber, isola", hbnlp.systems.tuned_absorber(), (3, 5), 25, (0.8, 2.6), start=on_the_isola)
    yield Case("chain of ten masses", hbnlp.systems.chain(10), (1, 3, 5), 25, (2.5, 0.2))
    pitching = {"pitch_amplitude": float(np.radians(2.5))}
    stretched = {"mass_ratio": 0.5, "stiffness": 250.0, "prestrain": 0.002}
    quasi = hbnlp.QuasiLinearMembrane(**stretched, n_modes=6)
    yield Case("wing, quasi-linear membrane", wing(quasi), (3, 5, 7), 31, (0.5, 8.0), pitching)
    full = hbnlp.NonlinearMembrane(**stretched, n_modes=4)
    yield Case("wing, nonlinear membrane", wing(full), (3, 5, 7), 31, (0.5, 8.0), pitching)
    yield Case(
        "friction, 0.1 tanh(10 x'), and x^3",
        own(lambda q, v, tau, p: [0.1 * ca.tanh(v[0] / 0.1) + q[0] ** 3], 0.02),
        (3, 5, 9, 13),
        61,
        (0.3, 3.0),
    )
    yield Case("contact, rounded over 0.1", own(contact, 0.1), (3, 5, 9, 13), 81, (0.3, 3.0))


def ratios(case: Case, n_harmonics: int) -> Array:
    """Return estimate by true error and the true error, (n_points, 2)."""
    problem = hbnlp.HarmonicBalance(case.system, n_harmonics)
    start = case.start(problem) if case.start is not None else None
    branch = hbnlp.trace(problem, "omega", case.span, at=case.at, start=start, stability=None, method=METHOD)
    curve = along_parameter(problem, problem.values(branch.solution(0).parameters), "omega", span=case.span)
    many = curve.on(problem.with_harmonics(case.many))
    found = []
    for i in range(1, len(branch) - 1, max(1, len(branch) // POINTS)):
        before, y, after = (curve.point(branch.coefficients[k], branch.parameter[k]) for k in (i - 1, i, i + 1))
        row = (after - before) / curve.scale(y) ** 2
        row /= np.linalg.norm(row)
        here, y = sampled(curve, y, row)
        there = many if many.problem.n_samples > here.problem.n_samples else here.on(many.problem)
        padded = there.carried_from(here, y)
        there, exact = sampled(there, padded, there.carried_from(here, row))
        if exact is None:
            continue
        size = float(np.linalg.norm(here.coefficients(y)))
        estimate = float(np.linalg.norm(Estimate(here, y, row, Bordered.at(here, y, row)).coefficients)) / size
        true = float(np.linalg.norm(there.coefficients(exact - padded))) / size
        if SMALLEST < true < LARGEST:
            found.append((estimate / true, true))
    return np.array(found).reshape(-1, 2)


def sampled(curve: Equations, y: Array, row: Array) -> tuple[Equations, Array | None]:
    """Return the point of a curve in a plane, with enough samples of the force; None where there is none."""
    while True:
        correction = correct(curve, y, row, Newton())
        if not correction.converged:
            return curve, None
        finer = curve.resampled(correction.y)
        if finer is None:
            return curve, correction.y
        curve, y = finer, correction.y


def main() -> None:
    """Print a table of all cases, or of those whose names hold a word."""
    logging.disable(logging.WARNING)
    print(
        "| system | H | points | true error | median ratio | worst ratios | below 0.01 |\n|---|---|---|---|---|---|---|"
    )
    for case in cases():
        if sys.argv[1:] and sys.argv[1] not in case.name:
            continue
        for n_harmonics in case.numbers:
            ratio, true = ratios(case, n_harmonics).T
            if not true.size:
                print(f"| {case.name} | {n_harmonics} | 0 | | | | |", flush=True)
                continue
            small = ratio[true < 0.01]
            worst, also = (f"{r.min():.2f} to {r.max():.2f}" if r.size else "" for r in (ratio, small))
            print(
                f"| {case.name} | {n_harmonics} | {true.size} | {true.min():.0e} to {true.max():.0e} | "
                f"{np.median(ratio):.3f} | {worst} | {also} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
