"""A frequency response from motion to loads, computed or measured: what a ROM is fitted to."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike

from hbnlp.aero.table import read_table, write_table
from hbnlp.core.checks import file_name, finite_array, instance_of, real_number, whole_number
from hbnlp.core.extras import from_extra
from hbnlp.core.layout import Column, Layout, mapping
from hbnlp.core.records import loaded, save_record
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.types import Array, ComplexArray
from hbnlp.tables.table import Table, table_of
from hbnlp.tables.tabular import Tabular

if TYPE_CHECKING:
    import control

_LAYOUT = Layout(
    kind="FrequencyResponse",
    columns={
        "omega": Column("m", about="angular frequency, U/c", units="1"),
        "values": Column("m N+1 N+2", complex, about="loads per motion, time factor exp(+i omega t)", units="1"),
        "static": Column("N+1 N+2", about="loads per motion at omega = 0", units="1"),
        "base_load": Column("N+1", about="steady load at the incidence of the response", units="1"),
    },
    entries={"provenance": mapping},
    dimensions={"m": "omega", "N+1": "load", "N+2": "motion"},
)

DIP = 0.1
"""A column smaller than this part of what it is at the frequencies around counts as that part."""

NOTHING = 1e-12
"""A column smaller than this part of the largest at the same frequency is rounding, and counts as that part."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FrequencyResponse(ReadOnlyArrays, Tabular):
    """Loads [C_L, dCp_1..dCp_N] per harmonic motion [alpha, z, W_1..W_N].

    Attributes
    ----------
    omega : ndarray, shape (m,)
        Angular frequencies, U/c, rising, above zero.
    values : ndarray of complex, shape (m, N+1, N+2)
        G(i omega), time factor exp(+i omega t).
    static : ndarray, shape (N+1, N+2)
        G(0).
    base_load : ndarray, shape (N+1,)
        Steady load at the incidence about which the response was taken.
    provenance : mapping
        Where the data come from, of what JSON can write; keys that are used are ``reynolds``, ``incidence``, ``drag``
        and ``source``.

    Raises
    ------
    ValueError
        If shapes disagree, values are not finite, or the frequencies do not rise.
    """

    omega: Array
    values: ComplexArray
    static: Array
    base_load: Array
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        omega, values = finite_array("omega", self.omega, (None,)), finite_array("values", self.values, kind=complex)
        static, base_load = finite_array("static", self.static), finite_array("base_load", self.base_load)
        instance_of("provenance", self.provenance, Mapping, "a mapping of names to what JSON can write")
        if omega.ndim != 1 or omega.size == 0 or not np.all(omega > 0.0) or not np.all(np.diff(omega) > 0.0):
            raise ValueError(
                f"omega is {omega!r}; give rising frequencies above zero (the static value goes to static)"
            )
        if values.ndim != 3 or values.shape[0] != omega.size or values.shape[2] != values.shape[1] + 1:
            raise ValueError(
                f"values has shape {values.shape}; ({omega.size}, N+1, N+2) is needed: a frequency, "
                "loads C_L, dCp_1..dCp_N, motions alpha, z, W_1..W_N"
            )
        if static.shape != values.shape[1:] or base_load.shape != values.shape[1:2]:
            raise ValueError(
                f"static {static.shape} and base_load {base_load.shape} do not fit values {values.shape}; "
                f"give {values.shape[1:]} and {values.shape[1:2]}"
            )
        for name, array in (("omega", omega), ("values", values), ("static", static), ("base_load", base_load)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        object.__setattr__(self, "provenance", dict(self.provenance))

    @property
    def n_modes(self) -> int:
        """Number N of membrane modes."""
        return len(self.static) - 1

    @property
    def load_names(self) -> list[str]:
        """Names of the rows: C_L, dCp_1, ..., dCp_N."""
        return ["C_L", *(f"dCp_{k}" for k in range(1, self.n_modes + 1))]

    @property
    def motion_names(self) -> list[str]:
        """Names of the columns: alpha, z, W_1, ..., W_N."""
        return ["alpha", "z", *(f"W_{k}" for k in range(1, self.n_modes + 1))]

    def truncated(self, n_modes: int) -> FrequencyResponse:
        """Return the response of the first ``n_modes`` membrane modes, its leading block."""
        advice = f": the response has {self.n_modes} modes"
        n_modes = whole_number("n_modes", n_modes, least=0, most=self.n_modes, advice=advice)
        y, u = slice(n_modes + 1), slice(n_modes + 2)
        return replace(self, values=self.values[:, y, u], static=self.static[y, u], base_load=self.base_load[y])

    def band(self, lowest: float, highest: float) -> FrequencyResponse:
        """Return the response at the frequencies from ``lowest`` to ``highest``, both included."""
        lowest, highest = real_number("lowest", lowest), real_number("highest", highest)
        inside = (self.omega >= lowest * (1 - 1e-9)) & (self.omega <= highest * (1 + 1e-9))
        if not inside.any():
            raise ValueError(
                f"no frequency lies from lowest = {lowest:g} to highest = {highest:g}; "
                f"give a band of the data, {self.omega[0]:g} to {self.omega[-1]:g}"
            )
        return replace(self, omega=self.omega[inside], values=self.values[inside])

    @property
    def column_sizes(self) -> Array:
        """What errors of the columns are relative to, (m, N+2): their norms over the loads, never zero.

        A column may vanish, at one frequency or at all of them. Where it is below a tenth of its median over five
        neighbouring frequencies or below 1e-12 of the largest column there, that tenth or that part takes the norm's
        place, and its largest norm where it is zero over a stretch. A response that is zero throughout has the size 1.
        """
        norms = np.linalg.norm(self.values, axis=1)
        # beyond the ends: what is known below, and nothing above, so that what grows is not a dip
        below, above = np.linalg.norm(self.static, axis=0), np.full(norms.shape[1], np.inf)
        around = np.median(sliding_window_view(np.stack([below, below, *norms, above, above]), 5, axis=0), axis=-1)
        around = np.where(np.isfinite(around), around, 0.0)
        sizes = np.maximum(norms, DIP * around)
        sizes = np.where(sizes > 0.0, sizes, norms.max(axis=0))
        sizes = np.maximum(sizes, NOTHING * sizes.max(axis=1, keepdims=True))
        return np.where(sizes > 0.0, sizes, 1.0)

    def column_errors(self, other: ArrayLike) -> Array:
        """Return the relative error of every column, ``|other - values|`` over its loads by `column_sizes`, (m, N+2).

        Parameters
        ----------
        other : array_like of complex, shape (m, N+1, N+2)
            Another response at the same frequencies, a ROM's for instance.
        """
        others: ComplexArray = finite_array("other", other, self.values.shape, kind=complex)
        errors: Array = np.linalg.norm(others - self.values, axis=1) / self.column_sizes
        return errors

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write one ``.npz`` file, all of it or nothing."""
        save_record(self, path, _LAYOUT)

    def to_frd(self) -> control.FrequencyResponseData:
        """Return the response as a ``control.FrequencyResponseData`` from motions to loads, G(i omega).

        Its inputs are `motion_names`, its outputs `load_names`; the static value and the steady load have no place.

        Raises
        ------
        ImportError
            If the package ``control`` is not installed (extra ``hbnlp[control]``).
        """
        package = from_extra("control", "control", "a control.FrequencyResponseData")
        values = np.moveaxis(self.values, 0, -1)
        return package.FrequencyResponseData(values, self.omega, inputs=self.motion_names, outputs=self.load_names)

    def _table(self) -> Table:
        names = {"load": self.load_names, "motion": self.motion_names}
        return table_of(self, _LAYOUT, axes=("omega",), labels=names)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> FrequencyResponse:
        """Read a file that `save` wrote.

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        LoadError
            (A `ValueError`.) If it is not a response.
        """
        with loaded(path, _LAYOUT) as content:
            return cls(**content)

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write a table with the columns omega, load, motion, real, imag; the static value has omega 0."""
        file_name("path", path)
        write_table(path, np.append(0.0, self.omega), np.concatenate([self.static[None], self.values]))

    @classmethod
    def from_csv(
        cls,
        path: str | os.PathLike[str],
        *,
        base_load: ArrayLike | None = None,
        provenance: Mapping[str, Any] | None = None,
    ) -> FrequencyResponse:
        """Read a table with the columns omega, load, motion, real, imag in any order of rows.

        ``load`` counts C_L, dCp_1, ... from 0 and ``motion`` alpha, z, W_1, ... from 0; rows with omega 0 are the
        static value, which must be there.

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        LoadError
            (A `ValueError`.) If it is no such table, a cell is no finite number, an entry is missing or given twice, or
            the static value is missing or complex; it names line, column and value.
        """
        file_name("path", path)
        base_load = None if base_load is None else finite_array("base_load", base_load, (None,))
        instance_of("provenance", provenance, Mapping | None, "a mapping of names to what JSON can write")
        omega, values = read_table(path)
        return cls(
            omega=omega[1:], values=values[1:], static=values[0].real,
            base_load=np.zeros(values.shape[1]) if base_load is None else base_load,
            provenance=provenance or {},
        )  # fmt: skip

    def __repr__(self) -> str:
        source = str(self.provenance.get("source", ""))
        return (
            f"FrequencyResponse: {self.n_modes} modes, {self.omega.size} frequencies "
            f"{self.omega[0]:g} to {self.omega[-1]:g}" + (f"\n  {source[:110]}" if source else "")
        )
