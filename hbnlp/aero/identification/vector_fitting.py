"""Vector fitting with poles common to the whole matrix and the static value exact.

With K = G(0) given, H(s) = (G(s) - K)/s is fitted by

    H(s) = D + M s + sum_i s R_i / (s - p_i) = (D + sum_i R_i) + M s + sum_i p_i R_i / (s - p_i),

which is the ROM's form, so that G(0) = K whatever the fit. Poles are relocated by the relaxed iteration of Gustavsen
[1]_ [2]_, each entry reduced by its own QR factorisation (Deschrijver et al. [3]_); poles that leave the left half
plane are reflected, and those that leave the band by far are brought back to where the data can tell them from D and M.
Weights make the error relative to the size of every column at every frequency.

Packages with vector fitting were looked at: scikit-rf's fits square network parameters, without a prescribed static
value and weights by column, so it does not serve.

References
----------
.. [1] B. Gustavsen, A. Semlyen, "Rational approximation of frequency domain responses by vector fitting", IEEE Trans.
   Power Delivery 14 (1999) 1052-1061, doi:10.1109/61.772353.
.. [2] B. Gustavsen, "Improving the pole relocating properties of vector fitting", IEEE Trans. Power Delivery 21 (2006)
   1587-1592, doi:10.1109/TPWRD.2005.860281.
.. [3] D. Deschrijver, M. Mrozowski, T. Dhaene, D. De Zutter, "Macromodeling of multiport systems using a fast
   implementation of the vector fitting method", IEEE Microw. Wireless Compon. Lett. 18 (2008) 383-385,
   doi:10.1109/LMWC.2008.922585.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hbnlp.aero.frequency_response import FrequencyResponse
from hbnlp.aero.identification.least_squares import least_squares, real_and_imaginary, real_least_squares
from hbnlp.aero.identification.modal import real_basis, residues, sort_poles
from hbnlp.core.checks import whole_number
from hbnlp.core.interrupts import check_interrupts
from hbnlp.core.types import Array, ComplexArray

BEYOND = 1e3
"""How far a pole may be below or above the band: the next terms that tell it from D and M are this much smaller."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PoleFit:
    """Poles and residues of a fit ``K + D s + M s^2 + s^2 sum_i residues[i] / (s - poles[i])``.

    Attributes
    ----------
    poles : ndarray of complex, shape (n,)
    residues : ndarray of complex, shape (n, N+1, N+2)
    stiffness, damping, mass : ndarray, shape (N+1, N+2)
    """

    poles: ComplexArray
    residues: ComplexArray
    stiffness: Array
    damping: Array
    mass: Array

    def transfer(self, s: ComplexArray) -> ComplexArray:
        """Return G at the points s (m,), shape (m, N+1, N+2)."""
        z = np.asarray(s, dtype=complex)[:, None, None]
        lags = np.einsum("mi,ijk->mjk", 1.0 / (z[:, 0] - self.poles), self.residues)
        result: ComplexArray = self.stiffness + z * self.damping + z**2 * (self.mass + lags)
        return result


def vector_fit(
    response: FrequencyResponse,
    *,
    n_poles: int,
    iterations: int = 30,
    least_damping: float = 1e-6,
    damping: Mapping[int, Array] | None = None,
) -> PoleFit:
    """Fit a response with a given number of common poles.

    Parameters
    ----------
    response : FrequencyResponse
    n_poles : int
        Number of poles, a complex pair counting as two; at most the number of frequencies less 2. None leaves K, D
        and M.
    iterations : int
        Number of pole relocations.
    least_damping : float
        Least damping ratio -Re(p)/|p| of a pole. Noise in the data is fitted by pairs near the imaginary axis, which
        have no place in the response of a stable flow: give 0.2, say, to keep them away.
    damping : mapping of int to ndarray, shape (N+1,), optional
        Columns of D that are known, by their index. Heave's (index 1) is minus the static load per pitch, less the drag
        coefficient in the row of C_L, as heave velocity at low frequency is minus incidence.

    Returns
    -------
    PoleFit

    Raises
    ------
    ValueError
        If there are too few frequencies for so many poles.
    """
    n = whole_number("n_poles", n_poles, least=0, most=max(0, response.omega.size - 2), advice=", or more frequencies")
    s = np.asarray(1j * response.omega, dtype=complex)
    h = (response.values - response.static) / s[:, None, None]
    weights = _weights(response)
    poles = sort_poles(-np.geomspace(response.omega[0], response.omega[-1], n))
    for _ in range(iterations if n else 0):
        check_interrupts()
        poles = _relocate(poles, s, h, weights, least_damping)
    return fit_residues(response, poles, damping=damping)


def fit_residues(
    response: FrequencyResponse, poles: ComplexArray, *, damping: Mapping[int, Array] | None = None
) -> PoleFit:
    """Return the weighted least-squares fit with given poles, ordered as `sort_poles` does, and known columns of D."""
    s = np.asarray(1j * response.omega, dtype=complex)
    h = (response.values - response.static) / s[:, None, None]
    weights = _weights(response)
    known = damping or {}
    # here the lag terms stand as s/(s - p), so that the constant is D
    basis = np.concatenate([s[:, None] * real_basis(poles, s), s[:, None], np.ones((s.size, 1))], axis=1)
    coefficients = np.empty((poles.size + 2, *h.shape[1:]))
    for column in range(h.shape[2]):
        w = weights[:, column, None]
        if column in known:
            coefficients[-1, :, column] = known[column]
            right = w * (h[:, :, column] - known[column])
            coefficients[:-1, :, column] = real_least_squares(w * basis[:, :-1], right)
        else:
            coefficients[:, :, column] = real_least_squares(w * basis, w * h[:, :, column])
    return PoleFit(
        poles=poles,
        residues=residues(poles, coefficients[:-2]),
        stiffness=response.static,
        damping=coefficients[-1],
        mass=coefficients[-2],
    )


def _weights(response: FrequencyResponse) -> Array:
    """Return weights for H, (m, columns), such that its weighted error is G's relative to the column's size."""
    return np.asarray(response.omega[:, None] / response.column_sizes)


def _relocate(
    poles: ComplexArray, s: ComplexArray, h: ComplexArray, weights: Array, least_damping: float
) -> ComplexArray:
    n = poles.size
    basis = real_basis(poles, s)
    common = np.concatenate([basis, np.ones((s.size, 1)), s[:, None]], axis=1)
    sigma = np.concatenate([basis, np.ones((s.size, 1))], axis=1)
    blocks = []
    for column in range(h.shape[2]):
        w = weights[:, column, None]
        left = real_and_imaginary(w * common)
        scale = np.linalg.norm(left, axis=0)
        q, _ = np.linalg.qr(left / scale)
        for row in range(h.shape[1]):
            right = real_and_imaginary(-w * h[:, row, column, None] * sigma)
            right -= q @ (q.T @ right)
            blocks.append(np.linalg.qr(right, mode="r"))
    # the relaxed condition: sigma has the mean 1 over the band, instead of the value 1 at infinity
    system = np.concatenate(blocks)
    size = np.linalg.norm(system) / np.sqrt(s.size)
    condition = size * sigma.real.sum(axis=0)[None] / s.size
    target = np.zeros(len(system) + 1)
    target[-1] = size
    full = np.concatenate([system, condition])
    solution = least_squares(full, target[:, None])[:, 0]
    constant = solution[-1]
    if abs(constant) < 1e-8:
        constant = np.copysign(1e-8, constant)
    a, b = _companion(poles)
    found = np.asarray(np.linalg.eigvals(a - np.outer(b, solution[:n]) / constant), dtype=complex)
    band = np.abs(s)
    found[found == 0.0] = -np.finfo(float).tiny
    sizes = np.abs(found)
    found *= np.clip(sizes, band.min() / BEYOND, band.max() * BEYOND) / sizes
    return sort_poles(found, least_damping=least_damping)


def _companion(poles: ComplexArray) -> tuple[Array, Array]:
    """Return real A, b with ``c (s I - A)^(-1) b = real_basis(poles, s) @ c``."""
    a = np.diag(poles.real)
    b = np.ones(poles.size)
    for i in np.flatnonzero(poles.imag > 0.0):
        a[i, i + 1], a[i + 1, i] = poles[i].imag, -poles[i].imag
        b[i], b[i + 1] = 2.0, 0.0
    return a, b
