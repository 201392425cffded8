"""What must hold on every branch, whatever was traced: for tests, and for users who want to be sure of theirs."""

from __future__ import annotations

import numpy as np

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.core.kinds import Kind
from hbnlp.core.stored import stored_result
from hbnlp.fourier import n_coefficients

__all__ = ["check_branch", "stored_result"]


def check_branch(
    branch: Branch, *, problem: HarmonicBalance | None = None, residual_tol: float = 1e-7, modulus_tol: float = 1e-6
) -> None:
    """Raise an AssertionError if a branch breaks an invariant.

    The residual, recomputed by the symbolic function where the problem is known, is small at every point and special
    point; arclength rises; parameter stays in the span; stability flags recount the multipliers; special points lie
    inside their brackets (a fold beyond both ends, as an extremum), at points of the branch, in order; shapes agree.

    Parameters
    ----------
    branch : Branch
    problem : HarmonicBalance, optional
        By default ``branch.problem``; without either, the recorded residuals are checked.
    residual_tol : float
        Bound on the residual relative to its terms.
    modulus_tol : float
        The tolerance of the Floquet analysis: a modulus up to one plus this is stable.
    """
    count = len(branch)
    most = branch.coefficients.shape[2] // 2
    assert branch.coefficients.shape[0] == count
    assert branch.amplitudes.shape == (count, len(branch.output_names), most + 1)
    assert branch.n_harmonics.shape == (count,)
    assert np.all((branch.n_harmonics >= 1) & (branch.n_harmonics <= most)), "numbers of harmonics are out of range"
    for row, n_harmonics in zip(branch.coefficients, branch.n_harmonics, strict=True):
        assert not np.any(row[:, n_coefficients(n_harmonics) :]), "harmonics beyond a point's own are not zero"
    assert np.all(np.isfinite(branch.coefficients)), "coefficients are not all finite"
    assert np.all(np.diff(branch.arclength) > 0.0), "arclength does not rise"
    low, high = sorted(branch.span)
    assert np.all((branch.parameter >= low) & (branch.parameter <= high)), "the parameter leaves the span"
    assert np.all(branch.residual <= residual_tol), f"a recorded residual is {branch.residual.max():.2e}"
    problem = problem or branch.problem
    if problem is not None:
        _check_residuals(branch, problem, residual_tol)
    if branch.stable is not None:
        assert branch.multipliers is not None
        moduli = np.abs(branch.multipliers)
        assert np.all(np.diff(moduli, axis=1) <= 1e-12 * moduli[:, :1]), "multipliers are not sorted"
        assert np.array_equal(branch.stable, moduli[:, 0] <= 1.0 + modulus_tol), (
            "stability flags do not recount multipliers"
        )
    _check_special_points(branch)


def _check_residuals(branch: Branch, problem: HarmonicBalance, tol: float) -> None:
    solutions = [branch.solution(i) for i in range(len(branch))] + [
        p.solution for p in branch.special_points if p.refined
    ]
    points = [
        (problem.carrying(s.n_harmonics), s.coefficients.ravel(), problem.values(s.parameters)) for s in solutions
    ]
    sizes = np.array([own.assembly.term_size(x, values) for own, x, values in points])
    # a branch may begin or end at rest, where there are no terms to compare with
    sizes = np.maximum(sizes, max(1e-9 * sizes.max(), 1e-300))
    for solution, (own, x, values), size in zip(solutions, points, sizes, strict=True):
        residual = np.abs(own.residual(x, values).full()).max()
        assert residual <= tol * size, (
            f"residual {residual:.2e} at {branch.name} = {solution.parameters[branch.name]:g}"
        )


def _check_special_points(branch: Branch) -> None:
    indices = [p.index for p in branch.special_points]
    assert indices == sorted(indices), "special points are not in branch order"
    slopes = np.sign(np.diff(branch.parameter))
    truncation = branch.problem.truncation if branch.problem is not None else None
    for point in branch.special_points:
        ends = branch.parameter[point.index], branch.parameter[point.index + 1]
        assert point.bracket == ends, f"{point} has the bracket {point.bracket}, the branch {ends}"
        low, high = min(ends), max(ends)
        width = max(high - low, 1e-9 * abs(high))
        if point.kind is Kind.FOLD:
            # the tolerance of the corrector, as points may crowd at a fold, and that of the harmonics, if they differ
            slack = max(1e-10, 0.0 if truncation is None else truncation.tolerance) * abs(high)
            beyond = point.value >= high - slack or point.value <= low + slack
            assert beyond, f"{point} is no extremum of its bracket"
            assert abs(point.value - 0.5 * (low + high)) <= 20.0 * width + 1e-3 * abs(high), f"{point} is far away"
    # a branch of broken symmetry turns at its pitchfork, which is a branch point
    folds = [p.index for p in (*branch.folds, *branch.branch_points)]
    turns = np.flatnonzero(slopes[1:] != slopes[:-1])
    for turn in turns:
        assert any(turn <= index <= turn + 1 for index in folds), (
            f"the parameter turns at point {turn + 1} without a fold or a branch point"
        )
