"""Inviscid thin-airfoil aerodynamics of a membrane wing in sine modes: exact, and as a ROM with Jones' lag states.

With v = s y + dy/dx the downwash of the motion y exp(s t), x = (1 + cos th)/2 and
P_n = (1/pi) int_0^pi v cos(n th) dth, the loads of Kuessner and Schwarz [1]_ are (chord 1, U = 1, all upward)::

    a_0 = C(s/2) (P_0 + P_1) - P_1,      a_n = P_n + s/(4 n) (P_{n-1} - P_{n+1})
    dCp = -4 a_0 tan(th/2) - 8 sum_n a_n sin(n th),      C_L = -2 pi (a_0 + a_1)

with Theodorsen's function C = K_1/(K_0 + K_1) [2]_. For pitch, heave and sine modes all integrals are Bessel
functions, so that G(s) = G_0 + G_1 s + G_2 s^2 + C(s/2) r (p_0 + p_1 s) with closed-form coefficients
(`thin_airfoil_coefficients`).

References
----------
.. [1] H. G. Kuessner, L. Schwarz, "Der schwingende Fluegel mit aerodynamisch ausgeglichenem Ruder",
   Luftfahrtforschung 17 (1940) 337-354.
.. [2] T. Theodorsen, "General theory of aerodynamic instability and the mechanism of flutter", NACA report 496 (1935).
.. [3] R. T. Jones, "The unsteady lift of a wing of finite aspect ratio", NACA report 681 (1940).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from hbnlp.aero.provenance import Provenance
from hbnlp.aero.rom import AeroROM
from hbnlp.core.checks import finite_array, whole_number
from hbnlp.core.types import Array, ComplexArray

MOST_MODES = 1000
"""Their coefficients take seconds to compute then."""
# Jones' approximation of Wagner's function, 1 - .165 exp(-.0455 t) - .335 exp(-.3 t) with t in semi-chords;
# here the rates are per chord.
JONES_WEIGHTS = (0.165, 0.335)
JONES_RATES = (2 * 0.0455, 2 * 0.3)


class ThinAirfoilCoefficients(NamedTuple):
    """Coefficients of G(s) = constant + linear s + quadratic s^2 + C(s/2) circulatory (static + rate s).

    Attributes
    ----------
    constant, linear, quadratic : ndarray, shape (N+1, N+2)
        Polynomial part: loads [C_L, dCp_1..dCp_N] per motion [alpha, z, W_1..W_N].
    circulatory : ndarray, shape (N+1,)
        Loads per unit of a_0.
    static, rate : ndarray, shape (N+2,)
        P_0 + P_1 = static + rate s, the downwash at three quarters of the chord in Theodorsen's sense.
    """

    constant: Array
    linear: Array
    quadratic: Array
    circulatory: Array
    static: Array
    rate: Array


def theodorsen_function(s: ArrayLike) -> ComplexArray:
    """Return Theodorsen's C(s/2) = K_1/(K_0 + K_1) of s/2, s per chord and stream velocity.

    Parameters
    ----------
    s : array_like of complex
        On the imaginary axis or to the right of it; C = 1 at s = 0.

    Raises
    ------
    ValueError
        If ``s`` is not finite or has a negative real part (C has a branch cut there).
    """
    points = finite_array("s", s, kind=complex)
    bad = points.real < 0.0
    if np.any(bad):
        raise ValueError(
            f"s holds {points[bad].flat[0]}; only finite values with a real part that is not negative are accepted "
            "(the exact transfer function has a branch cut along the negative real axis)"
        )
    # C = 1 + z log z + ..: equal to one in double precision long before the Bessel functions overflow
    half = points / 2.0
    small, large = np.abs(half) < 1e-100, np.abs(half) > 1e6
    z = np.where(small | large, 1.0, half)
    k0, k1 = special.kve(0, z), special.kve(1, z)
    # far out, where AMOS gives up: Hankel's expansions, whose next terms are below 1e-18
    r = 1.0 / np.where(large, half, 1.0)
    far = (1.0 + r * (3.0 - r * 15.0 / 16.0) / 8.0) / (2.0 + r * (2.0 - r * 6.0 / 16.0) / 8.0)
    return np.asarray(np.select([small, large], [1.0, far], k1 / (k0 + k1)), dtype=complex)


def thin_airfoil_coefficients(n_modes: int) -> ThinAirfoilCoefficients:
    """Return the closed-form coefficients of the inviscid transfer function, to machine precision.

    Parameters
    ----------
    n_modes : int
        Number N of sine modes, zero or more.

    Raises
    ------
    ValueError
        If ``n_modes`` is not an integer of at least 0.
    """
    n_modes = whole_number("n_modes", n_modes, least=0, most=MOST_MODES)
    modes = np.arange(1, n_modes + 1)
    beta = modes * np.pi / 2.0
    # J_n(beta) falls below 1e-20 within this many orders past n = beta
    last = 40 + int(2.5 * np.pi / 2.0 * n_modes)
    order = np.arange(last + 2)
    bessel = special.jv(order, beta[:, np.newaxis])
    # (1/pi) int_0^pi exp(i k pi x) cos(n th) dth = exp(i beta) i^n J_n(beta), beta = k pi/2
    sine = np.sin(beta[:, np.newaxis] + order * np.pi / 2.0) * bessel
    cosine = np.cos(beta[:, np.newaxis] + order * np.pi / 2.0) * bessel

    # P_n = slope + velocity s, (n_order, N+2), of the downwash s y + dy/dx of y = -x, 1 and sin(k pi x)
    slope = np.zeros((last + 2, n_modes + 2))
    velocity = np.zeros_like(slope)
    slope[0, 0] = -1.0
    velocity[:2, 0] = -0.5, -0.25
    velocity[0, 1] = 1.0
    slope[:, 2:] = (modes[:, np.newaxis] * np.pi * cosine).T
    velocity[:, 2:] = sine.T

    # a_n = P_n + s/(4 n) (P_{n-1} - P_{n+1}), n = 1..last
    quarter = 1.0 / (4.0 * order[1:-1, np.newaxis])
    a_constant = slope[1:-1]
    a_linear = velocity[1:-1] + quarter * (slope[:-2] - slope[2:])
    a_quadratic = quarter * (velocity[:-2] - velocity[2:])

    # loads of a_0 and a_n: 2 int_0^1 f sin(j pi x) dx = int_0^pi f sin(j pi x) sin(th) dth
    circulatory = np.concatenate([[-2.0 * np.pi], -4.0 * np.pi * (sine[:, 0] - sine[:, 1])])
    shapes = np.zeros((n_modes + 1, last))
    shapes[0, 0] = -2.0 * np.pi
    shapes[1:] = -4.0 * np.pi * (sine[:, :-2] - sine[:, 2:])
    return ThinAirfoilCoefficients(
        constant=shapes @ a_constant - np.outer(circulatory, slope[1]),
        linear=shapes @ a_linear - np.outer(circulatory, velocity[1]),
        quadratic=shapes @ a_quadratic,
        circulatory=circulatory,
        static=slope[0] + slope[1],
        rate=velocity[0] + velocity[1],
    )


def theodorsen_transfer(s: ArrayLike, n_modes: int = 10) -> ComplexArray:
    """Return the exact inviscid G(s) from motion [alpha, z, W_1..W_N] to loads [C_L, dCp_1..dCp_N].

    Parameters
    ----------
    s : array_like of complex, any shape (...)
        Laplace variable, U/c, on the imaginary axis or to the right of it; s = 0 gives the static loads.
    n_modes : int
        Number N of sine modes.

    Returns
    -------
    ndarray of complex, shape (..., N+1, N+2)
        Accurate to some 1e-14 of its largest entries.

    Raises
    ------
    ValueError
        If ``s`` is not finite or has a negative real part, or ``n_modes`` is not an integer of at least 0.
    """
    c = thin_airfoil_coefficients(n_modes)
    points: ComplexArray = finite_array("s", s, kind=complex)
    z = points[..., np.newaxis, np.newaxis]
    wake = theodorsen_function(s)[..., np.newaxis, np.newaxis]
    g: ComplexArray = (c.constant + z * c.linear + z**2 * c.quadratic).astype(complex)
    return g + wake * c.circulatory[:, np.newaxis] * (c.static + z * c.rate)


def thin_airfoil(n_modes: int = 10) -> AeroROM:
    """Return the inviscid thin-airfoil ROM with R. T. Jones' two lag states.

    Everything but Theodorsen's function is exact; C(s/2) is replaced by 1 - sum_i a_i s/(s + b_i), after R. T. Jones.
    On the imaginary axis that is off by at most 0.0146 (near omega = 0.8; at most 2.4 % of C) and exact in both limits,
    s = 0 and large s. The whole G(s) of ten modes is off by at most 0.71 % in the Frobenius norm.

    Parameters
    ----------
    n_modes : int
        Number N of sine modes.

    Raises
    ------
    ValueError
        If ``n_modes`` is not an integer of at least 0.
    """
    c = thin_airfoil_coefficients(n_modes)
    weights, rates = np.array(JONES_WEIGHTS), np.array(JONES_RATES)
    # s (p_0 + p_1 s)/(s + b) = p_0 s/b + s^2 (p_1 - p_0/b)/(s + b), so that what is left of C is a double zero at s = 0
    return AeroROM(
        stiffness=c.constant + np.outer(c.circulatory, c.static),
        damping=c.linear + np.outer(c.circulatory, c.rate - np.sum(weights / rates) * c.static),
        mass=c.quadratic,
        lag_state=-np.diag(rates),
        lag_input=c.rate - c.static / rates[:, np.newaxis],
        lag_output=-np.outer(c.circulatory, weights),
        provenance=Provenance(
            source="inviscid thin airfoil (Kuessner and Schwarz 1940), lags of R. T. Jones (NACA 681)"
        ),
    )
