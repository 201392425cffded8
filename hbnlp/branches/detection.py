"""Special points between two points of a branch: what Floquet multipliers and tangents say, and where exactly."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.linalg import eig
from scipy.optimize import linear_sum_assignment

from hbnlp.branches.branch import SpecialPoint
from hbnlp.branches.folds import fold_by_newton, fold_sensitivity, left_null_vector
from hbnlp.continuation.arclength import Continuation, Point, locate
from hbnlp.continuation.newton import Newton
from hbnlp.core.kinds import Kind
from hbnlp.core.types import Array, ComplexArray
from hbnlp.fourier import to_complex
from hbnlp.solutions.equations import ParameterCurve
from hbnlp.solutions.solution import make_solution
from hbnlp.stability.multipliers import NEGLIGIBLE, FloquetEvaluator, FloquetResult
from hbnlp.systems.lags import periodic_lag_states
from hbnlp.systems.system import System

Multipliers = Callable[[Point], FloquetResult]


def refined_fold(curve: ParameterCurve, before: Point, after: Point, index: int) -> SpecialPoint:
    """Return the fold between two points whose tangents differ in the sign of their parameter component."""
    a, b = before.tangent[-1], after.tangent[-1]
    share = a / (a - b)
    guess = before.y + share * (after.y - before.y)
    null = ((1.0 - share) * before.tangent + share * after.tangent)[:-1]
    problem, name = curve.problem, curve.name
    found = fold_by_newton(problem, guess[:-1], curve.values(guess), name, Newton(), null)
    y = np.append(found.y[: problem.size], found.y[-1])
    length = np.linalg.norm((after.y - before.y) / before.scale)
    refined = found.converged and bool(np.linalg.norm((y - guess) / before.scale) <= length)
    if not refined:
        return unrefined(curve, Kind.FOLD, before, after, index)
    x, values, null = y[:-1], curve.values(y), found.y[problem.size : -1]
    left = left_null_vector(problem, x, values, name, null)
    return SpecialPoint(
        kind=Kind.FOLD,
        value=float(y[-1]),
        bracket=(before.parameter, after.parameter),
        index=index,
        refined=True,
        solution=make_solution(
            problem, x, values, statistics={"residual": found.residual, "iterations": found.iterations}
        ),
        null=null.reshape(problem.shape),
        sensitivity=fold_sensitivity(problem, x, values, name, left),
    )


def branch_point(curve: ParameterCurve, before: Point, after: Point, index: int) -> SpecialPoint:
    """Return the branch point that the continuation located on its way to ``after``."""
    assert after.branch_point is not None
    point = after.branch_point
    return SpecialPoint(
        kind=Kind.BRANCH_POINT,
        value=point.parameter,
        bracket=(before.parameter, after.parameter),
        index=index,
        refined=True,
        solution=make_solution(
            curve.problem, point.y[:-1], curve.values(point.y), statistics={"residual": point.residual}
        ),
        null=point.null[:-1].reshape(curve.problem.shape),
    )


def crossings(a: FloquetResult, b: FloquetResult) -> tuple[Kind, ...]:
    """Return which Floquet bifurcations the multipliers of two neighbouring points imply.

    Folds and branch points (a multiplier through +1) are seen by the continuation itself and are not named here. The
    number of real multipliers beyond -1 changes parity at a period doubling; a pair of unstable multipliers that
    neither +1 nor -1 accounts for is a Neimark-Sacker bifurcation.
    """
    if not (a.converged and b.converged):
        return ()
    before, after, kinds = a.multipliers, b.multipliers, []
    doubling = (_beyond(before, -1.0) - _beyond(after, -1.0)) % 2
    if doubling:
        kinds.append(Kind.PERIOD_DOUBLING)
    unstable = abs(np.count_nonzero(np.abs(before) > 1.0) - np.count_nonzero(np.abs(after) > 1.0))
    through_one = (_beyond(before, 1.0) - _beyond(after, 1.0)) % 2
    # one may come in through +1 or -1 while a pair goes out, or a pair become real on its way through +1
    hidden = bool(doubling or through_one) and _pair_crosses(before, after)
    if unstable - doubling - through_one >= 2 or hidden:
        kinds.append(Kind.NEIMARK_SACKER)
    return tuple(kinds)


def floquet_bifurcation(
    stepper: Continuation, curve: ParameterCurve, kind: Kind, before: Point, after: Point, index: int, at: Multipliers
) -> SpecialPoint | None:
    """Return the period doubling or Neimark-Sacker point between two points; None if nothing of that kind is there."""
    if kind is Kind.PERIOD_DOUBLING:
        test = _doubling_test(at)
    else:
        pairs = min(_unstable_pairs(at(before).multipliers), _unstable_pairs(at(after).multipliers))
        if pairs == max(_unstable_pairs(at(before).multipliers), _unstable_pairs(at(after).multipliers)):
            return None
        test = _pair_test(at, pairs)
    located = locate(stepper, before, after, test) if test(before) * test(after) < 0.0 else None
    if located is None:
        return unrefined(curve, kind, before, after, index)
    multipliers = at(located).multipliers
    if kind is Kind.PERIOD_DOUBLING:
        critical = multipliers[np.argmin(np.abs(multipliers + 1.0))]
    else:
        pairs_only = multipliers[multipliers.imag > 0.0]
        critical = pairs_only[np.argmin(np.abs(np.abs(pairs_only) - 1.0))]
    return SpecialPoint(
        kind=kind,
        value=located.parameter,
        bracket=(before.parameter, after.parameter),
        index=index,
        refined=True,
        solution=make_solution(
            curve.problem, located.y[:-1], curve.values(located.y), statistics={"residual": located.residual}
        ),
        multiplier=complex(critical),
    )


def unrefined(curve: ParameterCurve, kind: Kind, before: Point, after: Point, index: int) -> SpecialPoint:
    """Return a special point that is only bracketed."""
    return SpecialPoint(
        kind=kind,
        value=after.parameter,
        bracket=(before.parameter, after.parameter),
        index=index,
        refined=False,
        solution=make_solution(
            curve.problem, after.y[:-1], curve.values(after.y), statistics={"residual": after.residual}
        ),
    )


def _beyond(multipliers: ComplexArray, bound: float) -> int:
    """Return how many real multipliers are > 1 (bound 1) or < -1 (bound -1)."""
    real = multipliers[np.abs(multipliers.imag) <= 1e-12 * np.abs(multipliers)].real
    return int(np.count_nonzero(real > 1.0) if bound > 0.0 else np.count_nonzero(real < -1.0))


def _unstable_pairs(multipliers: ComplexArray) -> int:
    return int(np.count_nonzero((np.abs(multipliers) > 1.0) & (multipliers.imag > 0.0)))


def _pair_crosses(before: ComplexArray, after: ComplexArray) -> bool:
    """Return whether a pair that is one at both points, each multiplier going to the nearest, crosses the circle."""
    rows, columns = linear_sum_assignment(np.abs(np.subtract.outer(before, after)))
    a, b = before[rows], after[columns]
    return bool(np.any((a.imag > 0.0) & (b.imag > 0.0) & ((np.abs(a) > 1.0) != (np.abs(b) > 1.0))))


def _doubling_test(at: Multipliers) -> Callable[[Point], float]:
    def test(point: Point) -> float:
        """Determinant of (monodromy + 1), of the multipliers that matter."""
        multipliers = at(point).multipliers
        return float(np.prod(1.0 + multipliers[np.abs(multipliers) > 1e-3]).real)

    return test


def _pair_test(at: Multipliers, pairs: int) -> Callable[[Point], float]:
    def test(point: Point) -> float:
        """How far the modulus of the pair that crosses is from one."""
        multipliers = at(point).multipliers
        moduli = np.sort(np.abs(multipliers[multipliers.imag > 0.0]))[::-1]
        return float(moduli[pairs] - 1.0) if moduli.size > pairs else -1.0

    return test


def with_multiplier(point: SpecialPoint, evaluator: FloquetEvaluator) -> SpecialPoint:
    """Return a fold or branch point with the Floquet multiplier that belongs to it: +1 but for the truncation.

    At a fold or branch point of the equations of motion the null vector of the balance is a periodic solution of the
    linearised equations, an eigenvector of the monodromy matrix. The multiplier is that of the eigenvector which the
    null vector's state, expanded in eigenvectors, holds most of; the one nearest to +1 may be that of a slow lag state.
    """
    solution = point.solution
    assert solution.problem is not None
    values = np.array(list(solution.parameters.values()))
    result = evaluator(solution.coefficients, values)
    if not np.isfinite(result.monodromy).all():
        return point
    jacobian = solution.problem.assembly.jacobian(solution.coefficients.ravel(), values)
    null = np.linalg.svd(jacobian)[2][-1].reshape(solution.problem.shape)
    rate = solution.omega / solution.periods
    state = _periodic_state(evaluator.system, to_complex(null), rate)
    decomposition: Any = eig(result.monodromy, left=True, right=True)
    found, left, right = decomposition
    matters = np.abs(found) > NEGLIGIBLE
    left, right = left[:, matters], right[:, matters]
    shares = np.abs(left.conj().T @ state) / np.maximum(np.abs(np.sum(left.conj() * right, axis=0)), 1e-300)
    n = evaluator.system.n_dof
    sizes = np.hypot(np.linalg.norm(right[:n], axis=0), np.linalg.norm(right[n : 2 * n], axis=0) / rate)
    critical = found[matters][np.argmax(shares * sizes)]
    nearest = result.multipliers[np.argmin(np.abs(result.multipliers - critical))]
    return dataclasses.replace(point, multiplier=complex(nearest))


def _periodic_state(system: System, amplitudes: ComplexArray, rate: float) -> Array:
    """Return the state (q, q', x) at theta = 0 of a periodic solution of the linearised equations."""
    s: ComplexArray = np.asarray(1j * rate * np.arange(amplitudes.shape[1]), dtype=complex)
    lags = periodic_lag_states(system, s, (system.lag_input @ (s**2 * amplitudes)).T)
    return np.concatenate([amplitudes.real.sum(axis=1), (s * amplitudes).real.sum(axis=1), lags])
