"""Floquet multipliers of the full state (q, q', x) about a harmonic-balance solution.

The linearised equations are integrated over the period (over one r-th of it, where their coefficients repeat r times)
by Gauss collocation for all initial states at once, of what varies alone beside a constant part that is exact
(`exponential.py`); the mesh is refined until a correction within its intervals hardly moves the multipliers.
Where the constant part has no eigenvectors, the whole equations are collocated, on two meshes that are compared.
Where coefficients switch, or turn sharply, these are graded towards such phases first.
"""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.checks import instance_of
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.types import Array
from hbnlp.solutions.attaching import attached
from hbnlp.solutions.solution import Solution
from hbnlp.stability.meshes import Exponential, Graded, OnMesh, Uniform
from hbnlp.stability.modes import ConstantPart, Modes
from hbnlp.stability.result import Floquet, FloquetResult
from hbnlp.stability.spectra import distance, ordered, product
from hbnlp.stability.variation import Linearisation, Variation
from hbnlp.systems.plant import Plant
from hbnlp.systems.system import System

FEWEST_GRADED = 48
"""Intervals of a period that a graded mesh begins with: a feature between their samples would not be seen."""
_MOVED = 0.5  # of the largest change within the period: where the mean moved less, the neighbour's modes will do
_RESOLVED = 0.1  # two meshes whose multipliers differ by more are both too coarse to learn from
_RESERVE = 0.1  # part of the tolerance that the next mesh aims at


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
    The error of a mesh whose constant part is exact is twice what a first-order correction of its defects changes, and
    what its nodes cannot see of the harmonics of the coefficients.

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
        cut = min(max(1e-5 * self.options.tol, 1e-13), 1e-11)
        self._linearised = Linearisation(system, periods, n_harmonics, tol=cut)

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
            The result at a neighbouring solution: this one begins with its mesh and its constant part.
        """
        x, p, period = self._checked(coefficients, values)
        plant, variation = self._linearised.plant(p), self._linearised.variation(x, p)
        if variation.at is None and variation.entries is None:
            return self._exact(self._mean_state_matrix(plant, variation), period)
        constant = self._constant_part(plant, variation, near)
        if constant is None:
            now, error, enough = self._compared(plant, variation, period, near)
        else:
            on = Exponential(constant, self._linearised, variation, period, self.options.nodes)
            now, error, enough = self._corrected(on, variation, period, near)
        repeats = variation.repeats
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
            constant_part=constant,
        )

    def _corrected(
        self, on: Exponential, variation: Variation, period: float, near: FloquetResult | None
    ) -> tuple[OnMesh, float, int]:
        """Return what one mesh gives, refined until its own estimate of the error will do; the next one's intervals."""
        nodes, tol, limit = self.options.nodes, self.options.tol, self._limit(variation)
        # what a mesh does not resolve it cannot tell, and a double multiplier moves by the square root of it
        least = max(on.prediction.least(max(30.0 * tol**2, 1e-12), limit), 2.0)
        guess = on.prediction.enough(_RESERVE * tol)
        intervals = self._first(guess, least, variation, period, near)
        while True:
            now = on(intervals)
            if now.error <= tol or intervals == limit:
                break
            growth = (now.error / (_RESERVE * tol)) ** (1.0 / nodes)
            intervals = min(ceil(intervals * min(max(growth, 1.1), 2.0)), limit)
        excess = now.error / (_RESERVE * tol)
        return now, now.error, ceil(intervals * min(max(excess ** (0.5 / nodes), 0.6), 1.3))

    def _compared(
        self, plant: Plant, variation: Variation, period: float, near: FloquetResult | None
    ) -> tuple[OnMesh, float, int]:
        """Return what the finer of two meshes gives, refined until they agree; the next one's intervals."""
        nodes, tol, limit = self.options.nodes, self.options.tol, self._limit(variation)
        smooth = variation.entries is None
        least = max(4 * variation.bandwidth / nodes / variation.repeats, 4) if smooth else FEWEST_GRADED
        guess = self._estimated_intervals(plant, variation, period) / variation.repeats
        fine = self._first(guess, least, variation, period, near)
        coarse, deviation = 2 * fine // 3, 1e-3 * tol**0.5
        uniform = Uniform(self._linearised, plant, variation, period, nodes)
        on_graded = Graded(self._linearised, plant, variation, period, nodes, self.options.max_intervals)

        def on(intervals: int) -> OnMesh:
            return uniform(intervals) if smooth else on_graded(intervals, deviation)

        before, now = on(coarse), on(fine)
        while True:
            change = distance(before.multipliers, now.multipliers)
            ratio = (coarse / fine) ** (0.5 * nodes if smooth else 0.5)
            error = change * ratio / (1.0 - ratio)
            if not smooth:
                error = error + deviation**2 if now.resolved else np.inf
            if error <= tol or fine == limit:
                break
            coarse, fine = fine, min(ceil(fine * (1.5 if change < _RESOLVED else 2.0)), limit)
            deviation *= 0.1
            before, now = now, on(fine)
        # A pair of meshes 2 to 3 that would just do, by the order of the method and with some reserve.
        excess = change * (2.0 / 3.0) ** (0.5 * nodes) / (0.2 * tol)
        return now, error, ceil(1.5 * coarse * min(max(excess ** (0.5 / nodes), 0.6), 1.3))

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

    def _limit(self, variation: Variation) -> int:
        return max(self.options.max_intervals // variation.repeats, 2)

    def _first(
        self, guess: float, least: float, variation: Variation, period: float, near: FloquetResult | None
    ) -> int:
        """Return the intervals of one repetition to begin with."""
        if near is not None and near.next_intervals:
            guess = near.next_intervals * period / near.period / variation.repeats
        elif self.options.intervals is not None:
            guess = self.options.intervals / variation.repeats
        limit = self._limit(variation)
        return max(ceil(min(guess, limit)), ceil(min(least, limit)))

    def _constant_part(self, plant: Plant, variation: Variation, near: FloquetResult | None) -> ConstantPart | None:
        """Return what is taken as exact, the neighbour's where it is not far from the mean; None if it has no modes."""
        if variation.amplitudes is None:
            return None
        assert variation.weights is not None
        sizes = variation.amplitudes.sum(axis=0)
        rows, columns = (np.unique(places[sizes > 0.0]) for places in self._linearised.places)
        key = b"".join(part.tobytes() for part in (*plant, rows, columns, variation.mean[sizes == 0.0]))
        known = None if near is None else near.constant_part
        if known is not None and known.key == key:
            moved = np.abs(variation.mean - known.entries) * variation.weights
            if moved.max() <= _MOVED * (sizes * variation.weights).max():
                return known
        state_matrix = self._mean_state_matrix(plant, variation)
        modes = Modes.of(plant, state_matrix, rows, columns, self.options.tol)
        return None if modes is None else ConstantPart(modes, variation.mean, key)

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
