"""Floquet multipliers of the full state (q, q', x) about a harmonic-balance solution.

The linearised equations are integrated over the period (over one r-th of it, where their coefficients repeat r times)
by Gauss collocation for all initial states at once, that of what varies alone where it touches few states and the rest
is fast (`exponential.py`); the mesh is refined until the multipliers of two meshes agree.
Where coefficients switch, or turn sharply, it is graded towards these phases first.
"""

from __future__ import annotations

from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.checks import instance_of
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.types import Array, ComplexArray
from hbnlp.solutions.solution import Solution, attached
from hbnlp.stability.collocation import Gauss, StepMaps
from hbnlp.stability.exponential import ExponentialMaps, MeanModes
from hbnlp.stability.grading import graded
from hbnlp.stability.result import Floquet, FloquetResult
from hbnlp.stability.spectra import distance, ordered, product, spectrum
from hbnlp.stability.variation import Linearisation, NodeValues, Variation
from hbnlp.systems.plant import Plant
from hbnlp.systems.system import System

FEWEST_GRADED = 48
"""Intervals of a period that a graded mesh begins with: a feature between their samples would not be seen."""
WORTH_MODES = 16
"""Intervals that collocation is expected to need beyond which the mean is diagonalised, and its part made exact."""
_RESOLVED = 0.1  # two meshes whose multipliers differ by more are both too coarse to learn from


class _OnMesh(NamedTuple):
    """What one mesh gives: multipliers, products of consecutive step maps, log-determinant of one repetition."""

    multipliers: ComplexArray
    maps: Array
    log_determinant: float
    n_intervals: int
    resolved: bool = True


class FloquetEvaluator:
    """Floquet multipliers of a system's periodic solutions; compiled once, called at every point.

    Parameters
    ----------
    system : System
    periods : int
        Forcing periods in one period of the solution.
    n_harmonics : int
        H of the coefficients, which are by ``theta = tau / periods``.
    options : Floquet

    Notes
    -----
    Gauss collocation is A-stable without damping. A mode that the mesh does not resolve keeps a modulus near one in the
    step map, hence shows when two meshes are compared, unlike with methods that damp it away. With rho the ratio of
    the two meshes, d the largest difference of their multipliers, paired, and m nodes, the error estimate is
    ``d rho^k / (1 - rho^k)`` with k = m / 2 instead of the order 2 m: the error of a double multiplier is a square
    root, and the order falls in stiff systems and on coarse meshes. On graded meshes k = 1/2, and a kink
    that is left within an interval adds the square of what it deviates from a polynomial.

    References
    ----------
    T. F. Fairgrieve, A. D. Jepson, O.K. Floquet multipliers, SIAM J. Numer. Anal. 28 (1991), doi:10.1137/0728075
    """

    def __init__(self, system: System, periods: int, n_harmonics: int, options: Floquet | None = None) -> None:
        if periods < 1 or n_harmonics < 1:
            raise ValueError(f"periods is {periods!r} and n_harmonics {n_harmonics!r}; both must be at least 1")
        self.system, self.periods, self.n_harmonics = system, int(periods), int(n_harmonics)
        self.options = options or Floquet()
        self._gauss = Gauss.of(self.options.nodes)
        cut = min(max(1e-5 * self.options.tol, 1e-13), 1e-11)
        self._linearised = Linearisation(system, periods, n_harmonics, nodes=self.options.nodes, tol=cut)

    @classmethod
    def of(cls, problem: HarmonicBalance, options: Floquet | None = None) -> FloquetEvaluator:
        """Return the evaluator for the solutions of a problem, compiled once and kept with it."""
        options = options or Floquet()
        evaluator: FloquetEvaluator = problem.kept.get(
            (cls, options), lambda: cls(problem.system, problem.periods, problem.n_harmonics, options)
        )
        return evaluator

    def __call__(
        self, coefficients: ArrayLike, values: ArrayLike, *, near: FloquetResult | None = None
    ) -> FloquetResult:
        """Return the multipliers of one solution.

        Parameters
        ----------
        coefficients : (n_dof, 2H+1)
        values : (n_parameters,)
            In the order of ``system.parameters.names``.
        near : FloquetResult, optional
            The result at a neighbouring solution: this one begins with its mesh.
        """
        x, p, period = self._checked(coefficients, values)
        plant, variation = self._linearised.plant(p), self._linearised.variation(x, p)
        if variation.at is None and variation.entries is None:
            return self._exact(self._mean_state_matrix(plant, variation), period)
        repeats, nodes, tol = variation.repeats, self.options.nodes, self.options.tol
        limit = max(self.options.max_intervals // repeats, 2)
        guess = self._estimated_intervals(plant, variation, period)
        modes = self._mean_modes(plant, variation) if guess > WORTH_MODES * repeats else None
        if modes is not None:
            guess = self._phase_intervals(modes.fastest(period), period)
        if near is not None and near.next_intervals:
            wanted = near.next_intervals * period / near.period
        else:
            wanted = self.options.intervals or guess
        least = FEWEST_GRADED if variation.entries is not None else 4 * variation.bandwidth / (repeats * nodes)
        fine = min(max(ceil(wanted / repeats), ceil(least), 4), limit)
        coarse = 2 * fine // 3
        deviation = 1e-3 * tol**0.5

        def on(intervals: int) -> _OnMesh:
            if variation.entries is not None:
                return self._on_graded(plant, variation, period, intervals, deviation)
            assert variation.at is not None
            step = period / repeats / intervals
            step_maps = (
                StepMaps(plant, self._gauss, step)
                if modes is None
                else ExponentialMaps(modes, self._mean(variation), self._gauss, step)
            )
            return self._on_mesh(step_maps, variation.at, intervals, repeats)

        before, now = on(coarse), on(fine)
        while True:
            change = distance(before.multipliers, now.multipliers)
            ratio = (coarse / fine) ** (0.5 * nodes if variation.entries is None else 0.5)
            error = change * ratio / (1.0 - ratio) + (0.0 if modes is None else modes.rounding)
            if variation.entries is not None:
                error = error + deviation**2 if now.resolved else np.inf
            if error <= tol or fine == limit:
                break
            coarse, fine = fine, min(ceil(fine * (1.5 if change < _RESOLVED else 2.0)), limit)
            deviation *= 0.1
            before, now = now, on(fine)
        # A pair of meshes 2 to 3 that would just do, by the order of the method and with some reserve.
        excess = change * (2.0 / 3.0) ** (0.5 * nodes) / (0.2 * tol)
        enough = ceil(1.5 * coarse * min(max(excess ** (0.5 / nodes), 0.6), 1.3))
        with np.errstate(over="ignore", invalid="ignore"):
            monodromy = np.linalg.matrix_power(product(now.maps)[0], repeats)
        return FloquetResult(
            multipliers=now.multipliers,
            monodromy=monodromy,
            period=period,
            log_determinant=repeats * now.log_determinant,
            error=error,
            n_intervals=repeats * now.n_intervals,
            next_intervals=repeats * enough,
            options=self.options,
        )

    def expected_log_determinant(self, coefficients: ArrayLike, values: ArrayLike) -> float:
        """Return the integral of the trace of the linearised state matrix over the period (Liouville's formula)."""
        x, p, period = self._checked(coefficients, values)
        matrix = self._mean_state_matrix(self._linearised.plant(p), self._linearised.variation(x, p))
        return float(period * np.trace(matrix))

    def _checked(self, coefficients: ArrayLike, values: ArrayLike) -> tuple[Array, Array, float]:
        x, p = np.asarray(coefficients, dtype=float), np.asarray(values, dtype=float)
        shape, parameters = (self.system.n_dof, 2 * self.n_harmonics + 1), self.system.parameters
        if x.shape != shape or not np.isfinite(x).all():
            what = "entries that are not finite" if x.shape == shape else f"shape {x.shape}"
            raise ValueError(f"the coefficients have {what}; finite ones of shape {shape} (n_dof, 2H+1) are needed")
        names = parameters.names
        if p.shape != (len(names),) or not np.isfinite(p).all() or p[parameters.index("omega")] <= 0.0:
            raise ValueError(f"the parameter values are {p}; finite ones of {', '.join(names)}, omega > 0, are needed")
        return x, p, float(2.0 * np.pi * self.periods / p[parameters.index("omega")])

    def _mean(self, variation: Variation) -> tuple[Array, Array | None]:
        by_q, by_v = self._linearised.matrices(variation.mean[None])
        return by_q[0], None if by_v is None else by_v[0]

    def _mean_modes(self, plant: Plant, variation: Variation) -> MeanModes | None:
        """Return the modes of the mean, None where collocation of the whole equations is used."""
        if variation.varying is None:
            return None
        by_q, by_v = self._linearised.matrices(variation.varying[None].astype(float))
        varying = by_q[0] if by_v is None else np.hstack([by_q[0], by_v[0]])
        return MeanModes.of(plant, self._mean_state_matrix(plant, variation), varying, self.options.tol)

    def _mean_state_matrix(self, plant: Plant, variation: Variation) -> Array:
        by_q, by_v = self._linearised.matrices(variation.mean[None])
        return plant.state_matrix(by_q[0], np.zeros_like(by_q[0]) if by_v is None else by_v[0])

    def _estimated_intervals(self, plant: Plant, variation: Variation, period: float) -> float:
        """Return a mesh of collocation for the fastest oscillation of the mean system."""
        by_q, _ = self._linearised.matrices(variation.mean[None])
        squares = np.linalg.eigvals(np.linalg.solve(plant.mass, plant.stiffness + by_q[0]))
        return self._phase_intervals(float(np.sqrt(np.abs(squares).max())), period)

    def _phase_intervals(self, frequency: float, period: float) -> float:
        """Return a mesh that resolves a frequency (measured: phase 0.4 a node for 1e-6)."""
        phase = 0.4 * self.options.nodes * (self.options.tol / 1e-6) ** (0.5 / self.options.nodes)
        return float(min(period * frequency / phase, self.options.max_intervals))

    def _on_mesh(self, step_maps: StepMaps | ExponentialMaps, at: NodeValues, intervals: int, repeats: int) -> _OnMesh:
        maps, log_determinant = [], 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            for first in range(0, intervals, step_maps.batch):
                last = min(first + step_maps.batch, intervals)
                steps = step_maps(*self._linearised.matrices(at(intervals, first, last)))
                log_determinant += float(np.linalg.slogdet(steps)[1].sum())
                maps.append(product(steps, 8 * (last - first) // intervals + 1))
            joined = np.concatenate(maps)
            multipliers = spectrum(joined) ** repeats
        return _OnMesh(_finite(multipliers), joined, log_determinant, intervals)

    def _on_graded(
        self, plant: Plant, variation: Variation, period: float, intervals: int, deviation: float
    ) -> _OnMesh:
        nodes, limit = self.options.nodes, self.options.max_intervals
        assert variation.entries is not None
        assert variation.weights is not None
        mesh = graded(variation.entries, intervals, nodes, tol=deviation, limit=limit, weights=variation.weights)
        maps = np.empty((len(mesh.levels), self.system.n_state, self.system.n_state))
        for level in np.unique(mesh.levels):
            step_maps = StepMaps(plant, self._gauss, period / intervals / 2.0**level)
            (places,) = np.nonzero(mesh.levels == level)
            for first in range(0, places.size, step_maps.batch):
                here = places[first : first + step_maps.batch]
                at_nodes = mesh.entries[here].reshape(here.size * nodes, -1)
                maps[here] = step_maps(*self._linearised.matrices(at_nodes))
        with np.errstate(over="ignore", invalid="ignore"):
            log_determinant = float(np.linalg.slogdet(maps)[1].sum())
            joined = product(maps, 8)
            multipliers = spectrum(joined)
        return _OnMesh(_finite(multipliers), joined, log_determinant, len(maps), mesh.resolved)

    def _exact(self, matrix: Array, period: float) -> FloquetResult:
        """Return the result for constant coefficients."""
        with np.errstate(over="ignore", invalid="ignore"):
            multipliers, monodromy = np.exp(np.linalg.eigvals(matrix) * period), expm(matrix * period)
        return FloquetResult(
            multipliers=ordered(multipliers.astype(complex)),
            monodromy=monodromy,
            period=period,
            log_determinant=float(np.trace(matrix) * period),
            error=0.0 if np.isfinite(multipliers).all() else np.inf,
            n_intervals=0,
            next_intervals=0,
            options=self.options,
        )


def _finite(multipliers: ComplexArray) -> ComplexArray:
    """Return multipliers in order; where one overflows, all are infinite."""
    return ordered(multipliers) if np.isfinite(multipliers).all() else np.full(len(multipliers), np.inf + 0j)


@interrupts_kept()
def floquet(solution: Solution, *, method: Floquet | None = None) -> FloquetResult:
    """Return the Floquet multipliers of one periodic solution, from `hbnlp.solve`, `hbnlp.find_all` or a branch.

    Parameters
    ----------
    solution : Solution
        Converged, and with its problem.
    method : Floquet, optional

    Raises
    ------
    ValueError
        If the solution did not converge, or came from a file, without its problem.
    """
    instance_of("solution", solution, Solution, "a Solution, such as branch.solution(0)")
    instance_of("method", method, Floquet | None, "Floquet(...)")
    problem = attached(solution)
    if not solution.converged:
        raise ValueError("the solution did not converge: it is no motion of the system, and has no stability")
    evaluate = FloquetEvaluator.of(problem, method)
    return evaluate(solution.coefficients, problem.system.parameters.ordered(solution.parameters))
