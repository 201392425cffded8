"""The describing function of a force: what it amounts to, in first harmonics, on a sine of some amplitude.

References
----------
A. Gelb, W. E. Vander Velde, *Multiple-Input Describing Functions and Nonlinear System Design*, McGraw-Hill (1968),
chapter 2 and appendix B.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hbnlp.core.checks import finite_array, real_number, refused
from hbnlp.core.errors import NonFiniteError
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.kept import by_one_thread
from hbnlp.core.types import ComplexArray
from hbnlp.systems.calling import called
from hbnlp.systems.expressions import check_symbols, column
from hbnlp.systems.parameters import ParameterSet
from hbnlp.systems.signals import PeriodicSignals


@interrupts_kept()
@by_one_thread
def describing_function(
    force: Callable[[Any, Any], Any], amplitude: ArrayLike, *, bias: float = 0.0, omega: float = 1.0
) -> ComplexArray:
    """Return the describing function N of a force f(q, q'): its first harmonic over that of ``q = b + A cos(omega t)``.

    ::

        N(A) = 1 / (pi A) int_0^2pi f(b + A cos tau, -A omega sin tau) exp(-i tau) dtau

    The real part acts as a stiffness, the imaginary part over omega as a damping. Steps and corners of the force are
    found on the motion, and the integrals taken between them: the error is below 1e-9 of the force's size.

    Parameters
    ----------
    force : callable (q, v) -> expression
        One number of CasADi's operations, as in a `System`: ``lambda q, v: ca.fmin(ca.fmax(q, -1.0), 1.0)``. Of a force
        with memory, which is none of q and q', there is none.
    amplitude : array_like, any shape (...)
        A, above zero.
    bias : float
        b, about which the input moves.
    omega : float
        Frequency of the input; it matters where the force depends on q'.

    Returns
    -------
    ndarray of complex, shape (...)

    Raises
    ------
    ValueError, TypeError
        If an amplitude or the frequency is not above zero, or the force is not one expression of q and v.
    SamplingError
        If the force is singular on the motion.
    NonFiniteError
        If the force is not finite everywhere on it.

    Examples
    --------
    >>> describing_function(lambda q, v: 0.1 * q**3, 2.0)
    array(0.3+0.j)
    """
    amplitudes = finite_array("amplitude", amplitude)
    if amplitudes.size and amplitudes.min() <= 0.0:
        raise refused(ValueError, "amplitude", amplitudes.min(), "amplitudes above zero")
    bias, omega = real_number("bias", bias), real_number("omega", omega, above=0.0)
    tau, p = ca.SX.sym("tau"), ca.SX.sym("p", 3)
    q, v = p[1] + p[0] * ca.cos(tau), -p[0] * p[2] * ca.sin(tau)
    expression = column("force", called("force", force, q=q, v=v), 1)
    check_symbols("force", expression, [tau, p])
    known = ParameterSet({"amplitude": 1.0, "bias": bias, "omega": omega})
    signal = PeriodicSignals("force", expression, tau, p, known)
    found = np.empty(amplitudes.shape, dtype=complex)
    for index, size in np.ndenumerate(amplitudes):
        _, cosine, sine = signal.coefficients(np.array([size, bias, omega]), 1)[0]
        found[index] = (cosine - 1j * sine) / size
        if not np.isfinite(found[index]):
            raise NonFiniteError(f"the force is not finite everywhere on a sine of amplitude {size:g} about {bias:g}")
    return found
