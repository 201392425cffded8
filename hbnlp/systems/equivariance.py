"""Whether a system has a symmetry, and by how much it fails: by numbers, at fixed random points.

With ``q(tau)`` also ``S q(tau + phi)`` solves ``M q'' + D q' + K q + f = G q + load`` if there is a matrix T with::

    M S = T M,   D S = T D,   K S = T K,   G(s) S = T G(s),
    f(S q, S v, tau) = T f(q, v, tau + phi),   load(tau) = T load(tau + phi)

The first gives ``T = M S M^-1``. Of lag states only what they do to the motion matters, the transfer function
``G(s) = L_x (s - A)^-1 B s^2`` and the part of the load that they pass on: they may be realised in any way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from hbnlp.core.kept import built_once
from hbnlp.core.types import Array, ComplexArray
from hbnlp.systems.plant import check_mass
from hbnlp.systems.symmetry import PERIOD, Symmetry

TOL = 1e-8
"""Terms that should be equal may differ by this, relative to their size."""
ROUNDING = 1e-12
"""And by this relative to the largest entry: what should be zero is a difference of such."""
SIZES = (1e3, 1.0, 1e-3, 1e-6, 1e-9)
"""Of displacements: in whatever units, near rest as far from it, no term of the force is hidden behind another."""
N_POINTS = 6
"""Random points of each size."""
STEP = 1e-5
"""Relative change of a point by which rounding shows, and hardly the force's own curvature."""
N_PHASES = 720
"""Of the load: shifts by simple fractions of a period lead from one to another, also where the load has jumps."""


@dataclass(frozen=True)
class Lack:
    """The term by which a system lacks a symmetry: its name, the misfit relative to its size, and where."""

    what: str
    misfit: float
    where: str

    def __str__(self) -> str:
        return f"{self.what} misses it by {self.misfit:.2g} of its terms ({self.where})"


class Equivariance:
    """The terms of a system as numbers, to be compared with what a symmetry makes of them.

    Parameters
    ----------
    matrices : casadi.Function
        p -> (M, D, K, L_x, ...).
    force : casadi.Function
        (q, q', tau, p) -> f.
    excitation : casadi.Function
        (tau, p) -> (load, B_u u'').
    lag_state, lag_input : array (m, m), (m, n)
        A and B.
    omega : int
        Position of the forcing frequency among the parameters.
    """

    def __init__(
        self,
        matrices: ca.Function,
        force: ca.Function,
        excitation: ca.Function,
        lag_state: Array,
        lag_input: Array,
        omega: int,
    ) -> None:
        self._matrices, self._lag_state, self._lag_input, self._omega = matrices, lag_state, lag_input, omega
        self.n_dof = int(lag_input.shape[1])
        self._force = force.map(len(SIZES) * N_POINTS)
        self._excitation = excitation.map(N_PHASES)

    def at(self, values: Array) -> Terms:
        """Return the terms at parameter values (n_parameters,), all of them numbers."""
        return Terms(self, values)

    @built_once
    def points(self) -> tuple[Array, Array, Array]:
        """Displacements and velocities by omega (n, n_points), and phases (n_points,)."""
        rng = np.random.default_rng(5)
        sizes = np.repeat(SIZES, N_POINTS)
        q, v = rng.uniform(-1.0, 1.0, (2, self.n_dof, sizes.size)) * sizes
        return q, v, rng.uniform(0.0, PERIOD, sizes.size)


class Terms:
    """The terms of a system at one parameter point; see `Equivariance`."""

    def __init__(self, source: Equivariance, values: Array) -> None:
        self._source, self._values = source, values
        self._mass, self._damping, self._stiffness, self._lag_output = (
            entry.full() for entry in source._matrices(values)[:4]
        )
        self._q, v, self._tau = source.points
        self._v = abs(values[source._omega]) * v

    def lack_of(self, symmetry: Symmetry) -> Lack | None:
        """Return the first term that does not go with a symmetry, or None where the system has it."""
        left, right = self._rows_moved_with(symmetry.matrix), symmetry.matrix
        for what, matrix in (("mass", self._mass), ("damping", self._damping), ("stiffness", self._stiffness)):
            lack = _compared(what, matrix @ right, left @ matrix, np.abs(matrix) @ np.abs(right))
            if lack is not None:
                return lack
        for s, transfer in self._transfers:
            what = f"the transfer function of the lag states at s = {s.imag:.3g}i"
            lack = _compared(what, transfer @ right, left @ transfer, np.abs(transfer) @ np.abs(right))
            if lack is not None:
                return lack
        lack = self._lack_in_load(left, symmetry.shift)
        return lack if lack is not None else self._lack_in_force(left, symmetry)

    def lack_of_turn(self, dof: int) -> Lack | None:
        """Return in what a displacement that is 2 pi larger shows, or None where it is an angle."""
        turn = np.zeros((self._source.n_dof, 1))
        turn[dof] = PERIOD
        like_a_turn = np.repeat(SIZES, N_POINTS) == 1.0
        here = self._force_at(self._q, self._v, self._tau)[:, like_a_turn]
        there = self._force_at(self._q + turn, self._v, self._tau)[:, like_a_turn] + self._stiffness @ turn
        size = np.abs(here) + np.abs(there) + np.abs(self._stiffness) @ turn
        return _compared("K q + nonlinear_force", there, here, _largest(size))

    def _rows_moved_with(self, matrix: Array) -> Array:
        """Return T: how the equations change places with the displacements."""
        n = self._source.n_dof
        if np.array_equal(np.abs(matrix), np.eye(n)) and abs(np.trace(matrix)) == n:
            return matrix  # of any mass matrix, a singular one too
        check_mass(self._mass)
        moved: Array = np.linalg.solve(self._mass.T, (self._mass @ matrix).T).T
        return moved

    @built_once
    def _transfers(self) -> list[tuple[complex, ComplexArray]]:
        """L_x (s - A)^-1 B at frequencies from below the slowest pole to beyond the fastest."""
        state, drive = self._source._lag_state, self._source._lag_input
        if not state.size:
            return []
        poles = np.abs(np.linalg.eigvals(state))
        fastest = float(poles.max()) or 1.0
        frequencies = np.geomspace(0.4 * max(float(poles.min()), 1e-6 * fastest), 2.3 * fastest, 5)
        identity = np.eye(state.shape[0])
        return [(1j * w, self._lag_output @ np.linalg.solve(1j * w * identity - state, drive)) for w in frequencies]

    @built_once
    def _load(self) -> tuple[ComplexArray, Array]:
        """Harmonics (n, N/2+1) of the load with what the lag states pass on, and the size (n, 1) of its terms."""
        tau = PERIOD * np.arange(N_PHASES) / N_PHASES
        load, lag_load = (e.full() for e in self._source._excitation(tau, self._values))
        direct, drive = (np.fft.rfft(e, axis=1) / N_PHASES for e in (load, lag_load))
        passed_on = np.zeros_like(direct)
        state = self._source._lag_state
        sizes = np.abs(drive)
        present = np.flatnonzero((sizes > ROUNDING * sizes.max(axis=1, keepdims=True, initial=0.0)).any(axis=0))
        present = present[present > 0]  # accelerations of a periodic motion have no mean
        if state.size and present.size:
            s = 1j * self._values[self._source._omega] * present
            responses = np.linalg.solve(s[:, None, None] * np.eye(state.shape[0]) - state, drive.T[present, :, None])
            passed_on[:, present] = self._lag_output @ responses[..., 0].T
        return direct + passed_on, _largest(np.abs(direct) + np.abs(passed_on))

    def _lack_in_load(self, left: Array, shift: float) -> Lack | None:
        harmonics, size = self._load
        moved = left @ harmonics * np.exp(1j * shift * np.arange(harmonics.shape[1]))
        return _compared("the load (forcing and motion)", harmonics, moved, size + np.abs(left) @ size, "harmonic")

    def _lack_in_force(self, left: Array, symmetry: Symmetry) -> Lack | None:
        here, rounding = self._force_before(symmetry.shift)
        there = self._force_at(symmetry.matrix @ self._q, symmetry.matrix @ self._v, self._tau)
        for k, size in enumerate(SIZES):
            part = np.arange(k * N_POINTS, (k + 1) * N_POINTS)
            defined = np.isfinite(here[:, part]).all(axis=0) | np.isfinite(there[:, part]).all(axis=0)
            part = part[defined]  # where it is so at one of two points that belong together, it must be so at both
            a, b, weights = there[:, part], left @ here[:, part], np.abs(left)
            terms, slack = np.abs(a) + weights @ np.abs(here[:, part]), 10.0 * weights @ rounding[:, part]
            column = f"displacements of size {size:g}, point"
            lack = _compared("nonlinear_force", a, b, _largest(terms), column, slack=_largest(slack))
            if lack is not None:
                return lack
        return None

    def _force_before(self, shift: float) -> tuple[Array, Array]:
        """Return f(q, v, tau + shift) and what rounding does to it, by second differences over 1e-5 of q and v."""
        q, v, tau = self._q, self._v, self._tau + shift
        here, ahead, back = (self._force_at(c * q, c * v, tau) for c in (1.0, 1.0 + STEP, 1.0 - STEP))
        with np.errstate(invalid="ignore", over="ignore"):
            rounding = np.abs(ahead - 2.0 * here + back)
        return here, np.where(np.isfinite(rounding), rounding, 0.0)

    def _force_at(self, q: Array, v: Array, tau: Array) -> Array:
        value: Array = self._source._force(q, v, tau, np.repeat(self._values[:, None], tau.size, axis=1)).full()
        return value


def _largest(terms: Array) -> Array:
    """Return the largest finite entry of each row as a column."""
    largest: Array = np.max(np.where(np.isfinite(terms), terms, 0.0), axis=1, keepdims=True, initial=0.0)
    return largest


def _compared(
    what: str, found: Any, wanted: Any, size: Array, column: str = "column", *, slack: Array | float = 0.0
) -> Lack | None:
    """Return where two arrays differ most beyond rounding, relative to the size of their terms; None: nowhere."""
    if not found.size:
        return None
    allowed = np.broadcast_to(TOL * size + ROUNDING * np.max(size) + slack, found.shape)
    with np.errstate(all="ignore"):
        apart = np.where(found == wanted, 0.0, np.abs(found - wanted))
        apart = np.where(np.isfinite(apart), apart, np.inf)
        excess = np.where(apart == 0.0, 0.0, apart / allowed)
        if excess.max() <= 1.0:
            return None
        row, place = (int(i) for i in np.unravel_index(int(np.argmax(excess)), excess.shape))
        misfit = apart[row, place] / np.broadcast_to(size, found.shape)[row, place]
    return Lack(what, float(misfit), f"row {row}, {column} {place}")
