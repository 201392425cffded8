"""Options of the Floquet analysis, and its result: multipliers and how well they are known."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

import numpy as np

from hbnlp.core.checks import real_number, whole_number
from hbnlp.core.layout import Column, Layout, mapping, number, text, whole
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.types import Array, ComplexArray
from hbnlp.stability.modes import ConstantPart
from hbnlp.tables.table import Table, table_of
from hbnlp.tables.tabular import Tabular

_LAYOUT = Layout(
    kind="floquet result",
    columns={
        "multipliers": Column("multipliers", complex, finite=False, about="by decreasing modulus", units="1"),
        "exponents": Column("multipliers", complex, finite=False, about="log(multiplier) / period"),
        "monodromy": Column("ends begins", finite=False, about="map of the state (q, q', lag states) over a period"),
    },
    entries={
        "period": number,
        "log_determinant": number,
        "error": number,
        "n_intervals": whole,
        "options": mapping,
        "message": text,
    },
    dimensions={"ends": "component_after", "begins": "component_before"},
)


@dataclass(frozen=True, kw_only=True)
class Floquet:
    """Options of the Floquet analysis.

    Parameters
    ----------
    tol : float
        Bound of the error of every multiplier mu of modulus above 1e-6, relative to max(1, abs(mu)).
    nodes : int
        Gauss nodes an interval, 1 to 10; the method has order ``2 * nodes``.
    intervals : int, optional
        Intervals a period to begin with; by default taken from the highest frequency of the mean linearised system.
    max_intervals : int
        Where refinement ends; the result then says that it has not converged.
    """

    tol: float = 1e-6
    nodes: int = 8
    intervals: int | None = None
    max_intervals: int = 8192

    def __post_init__(self) -> None:
        real_number("tol", self.tol, above=0.0, below=1.0, advice=", for instance 1e-6")
        whole_number("nodes", self.nodes, least=1, most=10, advice=", 8 is good for most systems")
        most = whole_number(
            "max_intervals", self.max_intervals, least=2, most=1_000_000, advice=", to compare two meshes"
        )
        if self.intervals is not None:
            whole_number("intervals", self.intervals, least=1, most=most, advice=", the max_intervals, or None")


@dataclass(frozen=True, kw_only=True, eq=False)
class FloquetResult(ReadOnlyArrays, Tabular):
    """Floquet multipliers of one periodic solution.

    Attributes
    ----------
    multipliers : (n_state,), complex
        By decreasing modulus.
    monodromy : (n_state, n_state)
        The map of the state (q, q', x) over one period, from theta = 0.
    period : float
    log_determinant : float
        Logarithm of the modulus of the monodromy matrix's determinant, summed over the step maps (no underflow). It may
        be rough where modes decay within a step whose constant part is integrated exactly.
    error : float
        Estimate, on the safe side, of the largest error of the multipliers relative to max(1, abs(mu)).
    n_intervals : int
        Intervals a period of the finest mesh; 0 where the coefficients are constant and the exponential is exact.
    next_intervals : int
        Intervals that a neighbouring solution of the same period is expected to need.
    options : Floquet
    constant_part : ConstantPart or None
        The part of the equations that was integrated exactly, with its modes; a neighbouring solution begins with it.
    """

    multipliers: ComplexArray
    monodromy: Array = field(repr=False)
    period: float
    log_determinant: float
    error: float
    n_intervals: int
    next_intervals: int
    options: Floquet
    constant_part: ConstantPart | None = field(default=None, repr=False)

    @property
    def converged(self) -> bool:
        """Whether the error is within the tolerance; if not, ``message`` says what to do."""
        return self.error <= self.options.tol

    @property
    def message(self) -> str:
        """What became of it, and what to do."""
        if self.converged:
            return "converged"
        if not np.isfinite(self.multipliers).all():
            return "not converged: the multipliers overflow; the solution is unstable beyond any number"
        tol, limit = self.options.tol, self.options.max_intervals
        return f"not converged to {tol:g} within {limit} intervals; increase max_intervals or tol"

    @property
    def stable(self) -> bool:
        """Whether no multiplier lies outside the unit circle by more than the tolerance."""
        return bool(abs(self.multipliers[0]) <= 1.0 + self.options.tol)

    @property
    def exponents(self) -> ComplexArray:
        """Floquet exponents ``log(mu) / period``, imaginary parts within half the solution's frequency."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(self.multipliers) / self.period, dtype=complex)

    def _table(self) -> Table:
        return table_of(self, _LAYOUT, options=asdict(self.options))

    def __repr__(self) -> str:
        leading = ", ".join(f"{mu:.8g}" for mu in self.multipliers[:4])
        more = f", ... ({len(self.multipliers)})" if len(self.multipliers) > 4 else ""
        return (
            f"FloquetResult: {'stable' if self.stable else 'unstable'}, period {self.period:.6g}\n"
            f"  multipliers: {leading}{more}\n"
            f"  error {self.error:.1e}, {self.n_intervals} intervals of {self.options.nodes} nodes: {self.message}"
        )
