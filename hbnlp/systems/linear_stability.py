"""Linear stability of a system about rest: eigenvalues of the full state, and its limits in any parameter."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from hbnlp.core.checks import finite_array, instance_of, two_values, whole_number
from hbnlp.core.errors import LinearInstabilityWarning
from hbnlp.core.interrupts import check_interrupts, interrupts_kept
from hbnlp.core.renamed import renamed_arguments, renamed_name
from hbnlp.core.types import ComplexArray
from hbnlp.systems.dependence import depends_on_omega
from hbnlp.systems.parameters import OMEGA
from hbnlp.systems.system import System

Point = tuple[float, ComplexArray]

# Real parts below this share of the largest eigenvalue are round-off: an undamped system is not unstable.
ROUND_OFF = 1e-10


@interrupts_kept()
@renamed_arguments()
def eigenvalues(
    system: System, at: Mapping[str, float] | None = None, *, rest: ArrayLike | None = None
) -> ComplexArray:
    """Return the eigenvalues of the full state (q, q', x), linearised about rest, the least stable first.

    Parameters
    ----------
    system : System
    at : mapping of parameter names to values, optional
        Overrides of the defaults; omega is needed only where a matrix or the force's derivative depends on it, as in
        a rotor that turns at this speed.
    rest : array_like, shape (n_dof,), optional
        Displacements about which the force is linearised; zero by default.

    Returns
    -------
    ndarray of complex, shape (n_state,)
        Growth rates and angular frequencies per unit of time.

    Raises
    ------
    ValueError, KeyError
        For a parameter that is not known, or a value that is no finite number or missing, omega's included where the
        linearisation depends on it.
    """
    instance_of("system", system, System, "a System, such as problem.system")
    values = np.asarray(np.linalg.eigvals(system.linearisation(at, rest=rest)), dtype=complex)
    return values[np.lexsort((-values.imag, -values.real))]


def check_linear_stability(
    system: System,
    at: Mapping[str, float] | None = None,
    *,
    rest: ArrayLike | None = None,
    stacklevel: int = 2,
) -> ComplexArray:
    """Return the eigenvalues about rest, and warn if one of them grows.

    Parameters are as in `eigenvalues`, and ``stacklevel`` as in `warnings.warn`. The warning names the eigenvalue and,
    where the system has an output ``"tension"``, the tension c_T at rest.

    Warns
    -----
    LinearInstabilityWarning
        If the largest real part exceeds 1e-10 of the largest modulus.
    """
    values = eigenvalues(system, at, rest=rest)
    if _n_unstable(values):
        worst = values[0]
        kind = "divergence" if worst.imag == 0.0 else "flutter"
        tension = _rest_output(system, "tension", at, rest)
        about = "" if tension is None else f" at c_T = {tension:.6g}"
        warnings.warn(
            f"{system.name} is linearly unstable about rest{about}: eigenvalue {worst:.6g} ({kind}), "
            f"{_n_unstable(values)} of {values.size} with a positive real part; small motions grow, "
            "and only the nonlinear force can bound them",
            LinearInstabilityWarning,
            stacklevel=stacklevel,
        )
    return values


@dataclass(frozen=True, kw_only=True)
class StabilityLimit:
    """A parameter value at which an eigenvalue, or a pair, crosses the imaginary axis.

    Attributes
    ----------
    name : str
        The parameter.
    value : float
        The limit.
    kind : {"divergence", "flutter"}
        Whether a real eigenvalue or a complex pair crosses.
    frequency : float
        Angular frequency of the motion at the limit; 0 for a divergence.
    unstable : {"below", "above"}
        The side of ``value`` on which it grows.
    """

    name: str
    value: float
    kind: Literal["divergence", "flutter"]
    frequency: float
    unstable: Literal["below", "above"]

    def __getattr__(self, name: str) -> Any:
        raise renamed_name("StabilityLimit", name, {"parameter": "name"})


@renamed_arguments(parameter="name")
@interrupts_kept()
def stability_limits(
    system: System,
    name: str,
    span: Sequence[float],
    *,
    at: Mapping[str, float] | None = None,
    rest: ArrayLike | None = None,
    n_points: int = 65,
) -> tuple[StabilityLimit, ...]:
    """Return all limits of linear stability about rest within a span of one parameter, in ascending order.

    The number of growing eigenvalues is counted at ``n_points`` values, and where the least stable eigenvalue crosses
    the imaginary axis and comes back in between. Each change is bracketed by bisection and refined by a secant, to some
    1e-12 of the span. Two limits that cancel between neighbouring points, of eigenvalues that are not the least stable,
    are missed.

    Parameters
    ----------
    system : System
    name : str
        Any parameter; omega, where a matrix or the force's derivative depends on it.
    span : two floats
        Its lowest and highest value, in either order.
    at : mapping of parameter names to values, optional
        Overrides of the other defaults.
    rest : array_like, shape (n_dof,), optional
        Displacements about which the force is linearised; zero by default.
    n_points : int
        Values at which growing eigenvalues are counted, at least 2; evenly spaced by ratio where the span covers more
        than a decade of one sign, by difference otherwise.

    Raises
    ------
    KeyError
        If there is no such parameter.
    ValueError
        If the span has zero length or is not finite, or ``name`` is omega and the linearisation does not depend on it.
    """
    instance_of("system", system, System, "a System, such as problem.system")
    system.parameters.index(name)
    system.parameters.values(at, but=(name, OMEGA))
    rest = None if rest is None else finite_array("rest", rest, (system.n_dof,))
    if name == OMEGA and not depends_on_omega(system, rest):
        raise ValueError(
            f"name is 'omega', the forcing's frequency, on which linear stability of {system.name!r} does not depend"
        )
    n_points = whole_number("n_points", n_points, least=2, most=1_000_000)
    low, high = sorted(two_values("span", span, f"values of {name}"))

    def spectrum(value: float) -> Point:
        check_interrupts()
        return value, eigenvalues(system, {**(at or {}), name: value}, rest=rest)

    by_ratio = low * high > 0.0 and max(abs(low), abs(high)) > 10.0 * min(abs(low), abs(high))
    grid = np.geomspace(low, high, n_points) if by_ratio else np.linspace(low, high, n_points)
    points = [spectrum(float(value)) for value in grid]
    points = sorted(points + _approaches(points, spectrum), key=lambda point: point[0])
    limits: list[StabilityLimit] = []
    width = 1e-8 * (high - low)
    stack = list(itertools.pairwise(points))[::-1]
    while stack:
        left, right = stack.pop()
        if _n_unstable(left[1]) == _n_unstable(right[1]):
            continue
        if right[0] - left[0] <= width:
            limits.append(_limit(name, left, right, spectrum))
            continue
        middle = spectrum(0.5 * (left[0] + right[0]))
        stack += [(middle, right), (left, middle)]
    return tuple(limits)


def _n_unstable(values: ComplexArray) -> int:
    return int(np.sum(values.real > ROUND_OFF * np.max(np.abs(values), initial=0.0)))


def _approaches(points: list[Point], spectrum: Callable[[float], Point]) -> list[Point]:
    """Return points between the given ones where the least stable eigenvalue has crossed the axis and comes back."""
    found: list[Point] = []
    for left, middle, right in zip(points[:-2], points[1:-1], points[2:], strict=True):
        sign = 1.0 if middle[1][0].real > 0.0 else -1.0
        if any(sign * middle[1][0].real > sign * other[1][0].real for other in (left, right)):
            continue

        def distance(value: float, sign: float = sign) -> float:
            return sign * float(spectrum(value)[1][0].real)

        nearest = minimize_scalar(distance, bounds=(left[0], right[0]), method="bounded")
        if nearest.fun < 0.0:
            found.append(spectrum(float(nearest.x)))
    return found


def _limit(name: str, left: Point, right: Point, spectrum: Callable[[float], Point]) -> StabilityLimit:
    """Return the limit within a narrow bracket, by the secant through the eigenvalue that crosses."""
    growing_right = _n_unstable(right[1]) > _n_unstable(left[1])
    grown, other = (right, left) if growing_right else (left, right)
    growing = grown[1][: _n_unstable(grown[1])]
    crossing = growing[-1]
    partner = other[1][np.argmin(np.abs(other[1] - crossing))]
    slope = (crossing.real - partner.real) / (grown[0] - other[0])
    value, values = spectrum(float(grown[0] - crossing.real / slope))
    crossing = values[np.argmin(np.abs(values - crossing))]
    return StabilityLimit(
        name=name,
        value=value,
        kind="divergence" if crossing.imag == 0.0 else "flutter",
        frequency=abs(float(crossing.imag)),
        unstable="above" if growing_right else "below",
    )


def _rest_output(system: System, name: str, at: Mapping[str, float] | None, rest: ArrayLike | None) -> float | None:
    """Return an output at rest; None if the system has none of that name, or it needs an omega that has no value."""
    if name not in system.output_names:
        return None
    n = system.n_dof
    values = system.parameters.values(at, but=(OMEGA,))
    q = np.zeros(n) if rest is None else np.asarray(rest, dtype=float)
    outputs = system.outputs(q, np.zeros(n), np.zeros(n), np.zeros(system.n_lags), 0.0, values)
    value = float(np.array(outputs)[system.output_index(name), 0])
    return value if np.isfinite(value) else None
