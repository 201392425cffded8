"""The error of a solution for want of harmonics, estimated from what the retained ones leave over.

A solution of H harmonics balances its equations in these; the residual R' in those beyond them, the defect, is what
truncation costs. Each harmonic beyond answers its defect almost alone, by its own dynamic stiffness and the mean of the
force's derivative, as its inertia is large; the retained harmonics answer what that changes in them, by their own
Jacobian::

    d_h = -Z_h^-1 R'_h(y),    Z_h = K - h^2 w^2 M + i h w D - lag + mean f_q + i h w mean f_v,    h = H+1..2H+1,
    [ R_y ]        [ R'(y + d) ]
    [ row ]  e = - [     0     ],    harmonics 0..H,

a sweep of a block iteration for Newton's step with 2 H + 1 harmonics. What is left in the harmonics beyond tells how
much they have to do with each other: where that is much, as where a mode resonates with one of them, the step is solved
for at once. ``row`` is the plane normal to the branch, so that the estimate stays finite at folds, where a change of
the residual moves the fold rather than the response. That a periodic Galerkin solution with a small defect has an
exact one nearby was shown by Urabe (1965, doi:10.1007/BF00284614).
"""

from __future__ import annotations

import numpy as np

from hbnlp.continuation.curve import TINY, Bordered
from hbnlp.core.checks import instance_of
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.types import Array, ComplexArray
from hbnlp.fourier import resize, to_complex, to_real
from hbnlp.solutions.attaching import attached
from hbnlp.solutions.equations import Equations, along_parameter
from hbnlp.solutions.solution import Solution

ALONE = 0.2
"""Harmonics that change each other by less than this part of what they are answer alone."""


@interrupts_kept()
def truncation_error(solution: Solution) -> float:
    """Return the estimated error of a solution for want of harmonics, at fixed parameters, relative to its size.

    On Duffing oscillators, an absorber, a chain, wings and friction it was the true error to a tenth in the median, and
    seldom off by more than a third where that is below 0.1; larger ones are told to be large. It grows without bound
    towards a fold, where the solution at a fixed parameter does so, too: along a branch that is traced to a tolerance
    it is measured normal to the branch.

    Raises
    ------
    ValueError
        If the solution came from a file, without its problem.
    """
    instance_of("solution", solution, Solution, "a Solution, such as branch.solution(0)")
    problem = attached(solution)
    values = problem.values(solution.parameters)
    curve = along_parameter(problem, values, "omega")
    estimate = Estimate(curve, curve.point(solution.coefficients, solution.omega), curve.unknowns.fixing_last())
    return float(np.linalg.norm(estimate.coefficients)) / max(float(np.linalg.norm(solution.coefficients)), TINY)


class Estimate:
    """What a solution with H harmonics on a curve lacks of one with 2 H + 1.

    Parameters
    ----------
    curve : Equations
        Without a condition.
    y, row : array (size + 1,)
        The solution, and the normal of the plane in which its better one is sought.
    factors : Bordered, optional
        Those of [dR/dy; row], at y or close to it.

    Attributes
    ----------
    finer : Equations
        The curve with 2 H + 1 harmonics.
    padded, change : array (finer.size + 1,)
        The solution as that curve sees it, and what is to be added to it.
    """

    def __init__(self, curve: Equations, y: Array, row: Array, factors: Bordered | None = None) -> None:
        self._n_harmonics = curve.problem.n_harmonics
        self.finer = curve.on(curve.problem.with_harmonics(2 * self._n_harmonics + 1))
        self.padded = self.finer.carried_from(curve, y)
        change = self._by_blocks(curve, y, factors if factors is not None else Bordered.at(curve, y, row))
        self.change = change if change is not None else self._at_once(self.finer.carried_from(curve, row))

    @property
    def coefficients(self) -> Array:
        """The change of the displacements' coefficients, (n_dof, 4H+3)."""
        return self.finer.coefficients(self.change)

    def _by_blocks(self, curve: Equations, y: Array, factors: Bordered) -> Array | None:
        """Return the change, each harmonic beyond on its own; None where they have much to do with each other."""
        values = curve.values(y)
        mean = curve.terms.mean_derivatives(curve.unknowns.coefficients(y), values)
        linear = self.finer.problem.assembly.linear
        blocks = linear.dynamic_stiffness(values, *mean)[self._n_harmonics + 1 :]
        try:
            first = self._beyond(self._defect(self.padded), blocks)
            change = self.finer.unknowns.joined(first.ravel(), np.zeros(1))
            left = self._defect(self.padded + change)
            second = self._beyond(left, blocks)
        except np.linalg.LinAlgError:
            return None
        if not float(np.linalg.norm(second)) <= ALONE * float(np.linalg.norm(first)):
            return None
        low = resize(left, self._n_harmonics).ravel()
        change[:-1] += second.ravel()
        return np.asarray(change + self.finer.carried_from(curve, -factors.solve(np.append(low, 0.0))))

    def _at_once(self, row: Array) -> Array:
        matrix = Bordered.at(self.finer, self.padded, row)
        return -matrix.solve(np.append(self.finer.residual(self.padded), 0.0))

    def _defect(self, y: Array) -> Array:
        return self.finer.residual(y).reshape(self.finer.problem.shape)

    def _beyond(self, defect: Array, blocks: ComplexArray) -> Array:
        """Return how the harmonics beyond H answer a defect (n, 4H+3), each on its own."""
        amplitudes = to_complex(defect)
        answer = np.zeros_like(amplitudes)
        right = -amplitudes[:, self._n_harmonics + 1 :].T[..., None]
        answer[:, self._n_harmonics + 1 :] = np.linalg.solve(blocks, right)[..., 0].T
        return to_real(answer)
