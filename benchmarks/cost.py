"""What a point costs: continuation and stability against LAPACK's LU of a matrix of the same size, in one run.

Prints CPU seconds (one BLAS thread) and ratios that hold on noisy machines, because both sides of each are timed in
turn, and how many sets of multipliers are asked for. Run it from the root of the repository::

    python benchmarks/cost.py            # the table
    python benchmarks/cost.py --growth   # growth with degrees of freedom, harmonics and lag states as well
    python benchmarks/cost.py --march    # a march by integration in time
    python benchmarks/cost.py --many     # many harmonics, with the peak memory (Unix)
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.linalg import lapack

import hbnlp
from hbnlp.stability.multipliers import FloquetEvaluator
from hbnlp.wing.coupling import MembraneWing

REPEATS = 3


def note_sets(asked: list[None]) -> None:
    """Have each set of multipliers that is asked for from now on noted in a list."""
    evaluated = FloquetEvaluator.__call__

    def noting(*args: object, **options: object) -> object:
        asked.append(None)
        return evaluated(*args, **options)  # type: ignore[arg-type]

    FloquetEvaluator.__call__ = noting  # type: ignore[method-assign, assignment]


def lu_seconds(size: int) -> float:
    """CPU seconds of one dense LU factorisation and solve by LAPACK (best of 25 batches)."""
    rng = np.random.default_rng(0)
    matrix, right = rng.standard_normal((size, size)), rng.standard_normal(size)
    count = max(3, int(2e7 / size**3))
    times = []
    for _ in range(25):
        begin = time.process_time()
        for _ in range(count):
            lu, pivots, _ = lapack.dgetrf(matrix)
            lapack.dgetrs(lu, pivots, right)
        times.append((time.process_time() - begin) / count)
    return float(np.median(times))


def measured(run: Callable[[], hbnlp.Branch], size: int) -> tuple[hbnlp.Branch, float, float]:
    """Return a branch, its CPU seconds and those of one LU, the medians of runs that alternate."""
    seconds, bound = [], []
    for _ in range(REPEATS):
        bound.append(lu_seconds(size))
        begin = time.process_time()
        branch = run()
        seconds.append(time.process_time() - begin)
    bound.append(lu_seconds(size))
    return branch, float(np.median(seconds)), float(np.median(bound))


def weak_lags(rom: hbnlp.AeroROM, count: int) -> hbnlp.AeroROM:
    """Return a ROM with as many lag states, those added real, stable and weak."""
    extra = count - rom.n_lags
    rng = np.random.default_rng(1)
    poles = -np.geomspace(0.05, 60.0, extra)
    return replace(
        rom,
        lag_state=np.block(
            [[rom.lag_state, np.zeros((rom.n_lags, extra))], [np.zeros((extra, rom.n_lags)), np.diag(poles)]]
        ),
        lag_input=np.vstack([rom.lag_input, rng.standard_normal((extra, rom.lag_input.shape[1]))]),
        lag_output=np.hstack([rom.lag_output, 1e-3 * rng.standard_normal((rom.lag_output.shape[0], extra))]),
    )


def wing(n_modes: int = 10, n_lags: int = 40) -> MembraneWing:
    """Return the membrane wing of c_T0 = 4 on inviscid aerodynamics with further weak lags."""
    rom = weak_lags(hbnlp.aero.thin_airfoil(n_modes=n_modes), n_lags)
    return hbnlp.membrane_wing(hbnlp.QuasiLinearMembrane(prestrain=0.008, n_modes=n_modes), rom)


PITCH = {"pitch_amplitude": np.radians(2.5)}


def row(name: str, *cells: str) -> None:
    print(f"{name:58s}" + "".join(f"{cell:>16s}" for cell in cells), flush=True)


def march() -> None:
    """Print what a march of the paper's wing by integration costs: 67 frequencies of 60 periods each."""
    membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
    system = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(n_modes=10))
    row("march by integration, omega 1 to 60, 60 periods each", "periods", "CPU s", "us a step")
    for method in (hbnlp.ExponentialRungeKutta4(), hbnlp.RungeKutta4()):
        begin, n_steps, periods, state = time.process_time(), 0, 0, None
        for omega in np.linspace(1.0, 60.0, 67):
            response = hbnlp.integrate(
                system, at={**PITCH, "omega": omega}, start=state, method=method, max_periods=60, throw=False
            )
            state, periods = response.state, periods + response.n_periods
            n_steps += response.n_periods * len(response.t)
        seconds = time.process_time() - begin
        row(f"  {type(method).__name__}", f"{periods}", f"{seconds:.1f}", f"{1e6 * seconds / n_steps:.1f}")


def table() -> None:
    """Print the table."""
    asked: list[None] = []
    note_sets(asked)
    row("case", "points", "CPU s", "ms a point", "LUs a point", "sets a point")

    def line(name: str, run: Callable[[], hbnlp.Branch], size: int) -> None:
        asked.clear()
        branch, seconds, bound = measured(run, size)
        n, sets = len(branch), len(asked) / REPEATS
        row(name, f"{n}", f"{seconds:.2f}", f"{1e3 * seconds / n:.2f}", f"{seconds / n / bound:.1f}", f"{sets / n:.1f}")

    chain = hbnlp.HarmonicBalance(hbnlp.systems.chain(10), n_harmonics=7)
    size = chain.size + 1
    line(
        "ten-mass chain, H = 7, 16 folds, no stability",
        lambda: hbnlp.trace(chain, "omega", (2.5, 0.2), stability=None),
        size,
    )
    line("ten-mass chain, H = 7, with Floquet multipliers", lambda: hbnlp.trace(chain, "omega", (2.5, 0.2)), size)
    balance = hbnlp.HarmonicBalance(wing(), n_harmonics=7)
    line(
        "wing, N = 10, 40 lags, H = 7, omega 0.1 to 60, no stability",
        lambda: hbnlp.trace(balance, "omega", (0.1, 60.0), at=PITCH, stability=None),
        balance.size + 1,
    )
    for omega in (0.1, 2.0, 20.0):
        line(
            f"  the same with Floquet multipliers, omega {omega:g} to {1.2 * omega:g}",
            lambda omega=omega: hbnlp.trace(
                balance, "omega", (omega, 1.2 * omega), at=PITCH, method=hbnlp.PseudoArclength(step=0.02, max_step=0.02)
            ),
            balance.size + 1,
        )
    branch = hbnlp.trace(balance, "omega", (0.1, 60.0), at=PITCH, stability=None)
    begin = time.process_time()
    balance.system.validity(branch)
    seconds = time.process_time() - begin
    row(
        "  whether the wing is to be believed", f"{len(branch)}", f"{seconds:.2f}", f"{1e3 * seconds / len(branch):.2f}"
    )
    line(
        "Duffing, H = 7, both folds, problem built anew",
        lambda: hbnlp.trace(
            hbnlp.HarmonicBalance(hbnlp.systems.duffing(), n_harmonics=7), "omega", (0.5, 2.0), stability=None
        ),
        16,
    )


def pair(
    problem: hbnlp.HarmonicBalance, span: tuple[float, float], at: dict[str, float]
) -> tuple[float, float, float, hbnlp.HarmonicBalance]:
    """Return CPU seconds a point without and with stability, and those of one LU."""
    short = hbnlp.PseudoArclength(max_points=60)
    bare, seconds, bound = measured(
        lambda: hbnlp.trace(problem, "omega", span, at=at, stability=None, method=short), problem.size + 1
    )
    stable, more, _ = measured(lambda: hbnlp.trace(problem, "omega", span, at=at, method=short), problem.size + 1)
    return seconds / len(bare), more / len(stable), bound, problem


def growth() -> None:
    """Print milliseconds a point against sizes, with the exponent of a fit to the larger half."""
    for name, values, make in (
        ("masses, H = 5", (2, 5, 10, 20, 40), lambda n: hbnlp.HarmonicBalance(hbnlp.systems.chain(n), n_harmonics=5)),
        (
            "harmonics, 5 masses",
            (1, 3, 7, 15, 31),
            lambda h: hbnlp.HarmonicBalance(hbnlp.systems.chain(5), n_harmonics=h),
        ),
        (
            "lag states, wing N = 5, H = 5",
            (2, 10, 20, 40, 80),
            lambda m: hbnlp.HarmonicBalance(wing(5, m), n_harmonics=5),
        ),
    ):
        print(f"\ngrowth with {name}")
        row("value", "unknowns", "no stability ms", "stability ms", "LUs a point")
        plain, full = [], []
        at, span = (PITCH, (1.0, 3.0)) if "wing" in name else ({}, (2.4, 1.6))
        for value in values:
            bare, stable, bound, problem = pair(make(value), span, at)
            plain.append(bare)
            full.append(stable)
            row(f"{value}", f"{problem.size}", f"{1e3 * bare:.2f}", f"{1e3 * stable:.2f}", f"{bare / bound:.1f}")
        slopes = [np.polyfit(np.log(values[2:]), np.log(times[2:]), 1)[0] for times in (plain, full)]
        row("exponent", "", f"{slopes[0]:.2f}", f"{slopes[1]:.2f}")


def many_harmonics() -> None:
    """Print what many harmonics take: a first solution, its multipliers, a point of a branch, memory until then."""
    import resource  # noqa: PLC0415 (of Unix)

    unit = 1.0 if sys.platform == "darwin" else 1024.0
    short = hbnlp.PseudoArclength(max_points=8)
    row("case", "unknowns", "solution CPU s", "multipliers s", "ms a point", "LUs a point", "peak MB")
    for name, make, count, at in (
        ("Duffing", hbnlp.systems.duffing, 31, 1.6),
        ("Duffing", hbnlp.systems.duffing, 101, 1.6),
        ("ten-mass chain", hbnlp.systems.chain, 31, 2.4),
        ("Duffing", hbnlp.systems.duffing, 301, 1.6),
        ("ten-mass chain", hbnlp.systems.chain, 101, 2.4),
    ):
        times = [time.process_time()]
        problem = hbnlp.HarmonicBalance(make(), n_harmonics=count)
        solution = hbnlp.solve(problem, at={"omega": at})
        times.append(time.process_time())
        hbnlp.floquet(solution)
        times.append(time.process_time())
        branch = hbnlp.trace(solution, "omega", (at, 0.8 * at), stability=None, method=short)
        times.append(time.process_time())
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
        first, stability, trace = np.diff(times)
        bound = lu_seconds(problem.size + 1)
        row(
            f"{name}, H = {count}",
            f"{problem.size}",
            f"{first:.2f}",
            f"{stability:.2f}",
            f"{1e3 * trace / len(branch):.1f}",
            f"{trace / len(branch) / bound:.1f}",
            f"{peak:.0f}",
        )


if __name__ == "__main__":
    warnings.simplefilter("ignore", hbnlp.ValidityWarning)  # the motions are what they are: here they are timed
    if "--many" in sys.argv[1:]:  # first: a peak is that of the whole run
        many_harmonics()
    table()
    if "--growth" in sys.argv[1:]:
        growth()
    if "--march" in sys.argv[1:]:
        march()
