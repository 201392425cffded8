"""The record of an aerodynamic reduced-order model (ROM): rational function from motion to loads."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.aero import statespace
from hbnlp.aero.arrays import ARRAYS, MATRICES, checked_arrays
from hbnlp.aero.provenance import Provenance
from hbnlp.core.checks import finite_array, instance_of, whole_number
from hbnlp.core.layout import Column, Layout, mapping
from hbnlp.core.records import loaded, save_record
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.types import Array, ComplexArray

if TYPE_CHECKING:
    import control


_LAYOUT = Layout(
    kind="AeroROM",
    columns={
        **dict.fromkeys(("stiffness", "damping", "mass"), Column("N+1 N+2")),
        "lag_state": Column("n n"),
        "lag_input": Column("n N+2"),
        "lag_output": Column("N+1 n"),
        "base_motion": Column("N+2"),
        "base_load": Column("N+1"),
    },
    entries={"provenance": mapping},
)


@dataclass(frozen=True, init=False, repr=False, eq=False)
class AeroROM(ReadOnlyArrays):
    """Rational aerodynamics from the motion u = [alpha, z, W_1..W_N] to the loads y = [C_L, dCp_1..dCp_N].

    ::

        y = y_b + K (u - u_b) + D u' + M u'' + C x,      x' = A x + B u''
        G(s) = K + D s + M s^2 + s^2 C (s I - A)^(-1) B

    Everything is nondimensional (chord, stream velocity, density; rad) in the conventions of the package: heave z of
    the leading edge and displacement w upward, pitch about the leading edge nose-up, ``w = sum_k W_k sin(k pi x)``,
    ``dCp_k = 2 int_0^1 dCp sin(k pi x) dx`` [1]_ [2]_ [3]_. A copy with changes, checked again, is
    ``dataclasses.replace(rom, damping=...)``.

    Parameters
    ----------
    stiffness, damping, mass : array_like, shape (N+1, N+2)
        K, D and M: loads per motion, velocity and acceleration.
    lag_state : array_like, shape (n, n)
        A, all eigenvalues in the open left half plane; n = 0 (no lag states) is allowed.
    lag_input : array_like, shape (n, N+2)
        B, the lag states' drive by acceleration.
    lag_output : array_like, shape (N+1, n)
        C, the loads from the lag states.
    base_motion : array_like, shape (N+2,), optional
        u_b, about which the ROM was identified; zero by default.
    base_load : array_like, shape (N+1,), optional
        y_b, the steady load at u_b; zero by default.
    provenance : Provenance, optional
        Where the ROM comes from and where it holds.

    Raises
    ------
    ValueError
        If shapes disagree, a value is complex or not finite, or A is not strictly stable.
    TypeError
        If ``provenance`` is not a `Provenance`.

    References
    ----------
    .. [1] K. L. Roger, "Airplane math modeling methods for active control design", AGARD-CP-228 (1977).
    .. [2] M. Karpel, "Design for active flutter suppression and gust alleviation using state-space aeroelastic
       modeling", J. Aircraft 19 (1982) 221-227, doi:10.2514/3.57379.
    .. [3] S. L. Brunton, C. W. Rowley, D. R. Williams, "Reduced-order unsteady aerodynamic models at low Reynolds
       numbers", J. Fluid Mech. 724 (2013) 203-233, doi:10.1017/jfm.2013.163.
    """

    stiffness: Array
    damping: Array
    mass: Array
    lag_state: Array
    lag_input: Array
    lag_output: Array
    base_motion: Array
    base_load: Array
    provenance: Provenance

    # written by hand because it takes lists, and None for zero, where the fields are arrays
    def __init__(
        self,
        *,
        stiffness: ArrayLike,
        damping: ArrayLike,
        mass: ArrayLike,
        lag_state: ArrayLike,
        lag_input: ArrayLike,
        lag_output: ArrayLike,
        base_motion: ArrayLike | None = None,
        base_load: ArrayLike | None = None,
        provenance: Provenance | None = None,
    ) -> None:
        given = (stiffness, damping, mass, lag_state, lag_input, lag_output, base_motion, base_load)
        arrays = checked_arrays(dict(zip(ARRAYS, given, strict=True)))
        provenance = Provenance() if provenance is None else provenance
        instance_of("provenance", provenance, Provenance, "hbnlp.aero.Provenance(source=..., reynolds=...)")
        for name, array in arrays.items():
            object.__setattr__(self, name, array)
        object.__setattr__(self, "provenance", provenance)

    @property
    def n_modes(self) -> int:
        """Number N of membrane modes."""
        return int(self.stiffness.shape[0]) - 1

    @property
    def n_lags(self) -> int:
        """Number n of lag states."""
        return int(self.lag_state.shape[0])

    @property
    def poles(self) -> ComplexArray:
        """Eigenvalues of the lag states, (n,), the slowest-decaying first."""
        values = np.asarray(np.linalg.eigvals(self.lag_state), dtype=complex)
        return values[np.lexsort((values.imag, -values.real))]

    def transfer(self, s: ArrayLike) -> ComplexArray:
        """Return G(s) = K + D s + M s^2 + s^2 C (s I - A)^(-1) B, the loads per motion exp(s t).

        Parameters
        ----------
        s : array_like of complex, any shape (...)
            Laplace variable, U/c; i omega for a frequency response.

        Returns
        -------
        ndarray of complex, shape (..., N+1, N+2)
            At s = 0 exactly ``stiffness``.

        Raises
        ------
        ValueError
            If ``s`` is not finite or is a pole of the ROM.

        Warns
        -----
        OutsideBandWarning
            If ``s`` holds frequencies, points of the imaginary axis, outside the band of the ROM's provenance. Zero is
            no such point: the static value is exact.
        """
        return self._loads_per_motion(s)

    def __call__(self, s: ArrayLike) -> ComplexArray:
        """Return the loads per motion exp(s t), as `transfer` does: a system of python-control is called so, too."""
        return self._loads_per_motion(s)

    def _loads_per_motion(self, s: ArrayLike) -> ComplexArray:
        points = finite_array("s", s, kind=complex)
        self.provenance.warn_outside_band(points, stacklevel=4)
        z = points[..., np.newaxis, np.newaxis]
        g: ComplexArray = (self.stiffness + z * self.damping + z**2 * self.mass).astype(complex)
        if self.n_lags:
            # as many right-hand sides as matrices: NumPy 1 would take one matrix of them for a stack of vectors
            inputs = np.broadcast_to(self.lag_input.astype(complex), (*points.shape, *self.lag_input.shape))
            try:
                states = np.linalg.solve(z * np.eye(self.n_lags) - self.lag_state, inputs)
            except np.linalg.LinAlgError as error:
                raise ValueError(f"s meets a pole of the ROM; evaluate it away from its poles {self.poles}") from error
            g = g + z**2 * (self.lag_output @ states)
        return g

    def truncated(self, n_modes: int) -> AeroROM:
        """Return the ROM of the first ``n_modes`` membrane modes, its leading block, with all lag states.

        Raises
        ------
        ValueError
            If ``n_modes`` is negative or more than this ROM has.
        """
        advice = f": the ROM has {self.n_modes} modes, identify one with more if you need them"
        n_modes = whole_number("n_modes", n_modes, least=0, most=self.n_modes, advice=advice)
        y, u = slice(n_modes + 1), slice(n_modes + 2)
        return replace(
            self,
            stiffness=self.stiffness[y, u],
            damping=self.damping[y, u],
            mass=self.mass[y, u],
            lag_input=self.lag_input[:, u],
            lag_output=self.lag_output[y],
            base_motion=self.base_motion[u],
            base_load=self.base_load[y],
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the ROM to one ``.npz`` file, without pickle, all of it or nothing; the name is taken as given.

        Parameters
        ----------
        path : str or path-like
            The file; one of this name is replaced.

        Raises
        ------
        SaveError
            If the file cannot be written.
        """
        save_record(self, path, _LAYOUT, provenance=asdict(self.provenance))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> AeroROM:
        """Read a ROM that `save` wrote; it is validated again.

        Parameters
        ----------
        path : str or path-like

        Returns
        -------
        AeroROM

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        LoadError
            (A `ValueError`.) If it is not a valid ROM.
        """
        with loaded(path, _LAYOUT) as content:
            return cls(**content | {"provenance": Provenance(**content["provenance"])})

    def to_statespace(self) -> control.StateSpace:
        """Return the ROM as a ``control.StateSpace`` from accelerations: input u'', states [u, u', x], output y.

        Its transfer function is G(s)/s^2 and its output y - y_b + K u_b. Base motion, base load and provenance have no
        place in its matrices; its attribute ``aero_rom`` is this ROM, so that the way back, `from_statespace`, gives
        an equal one, provenance included. Systems that python-control makes of it have no such attribute.

        Raises
        ------
        ImportError
            If the package ``control`` is not installed (extra ``hbnlp[control]``).
        """
        system = statespace.pack(**{name: getattr(self, name) for name in MATRICES})
        system.aero_rom = self
        return system

    @classmethod
    def from_statespace(
        cls,
        system: control.StateSpace,
        *,
        base_motion: ArrayLike | None = None,
        base_load: ArrayLike | None = None,
        provenance: Provenance | None = None,
    ) -> AeroROM:
        """Return the ROM in a ``control.StateSpace`` whose input is u'' and whose states are [u, u', x].

        Parameters
        ----------
        system : control.StateSpace
            In continuous time and in the form that `to_statespace` gives; another basis of the lag states is allowed.
        base_motion, base_load, provenance
            As in `AeroROM`. By default those of the ROM from which `to_statespace` made this very system; where its
            matrices are others, zero and a provenance that names the system, for what was known of a ROM does not hold
            for another one.

        Raises
        ------
        ValueError
            If the system is not of that form or its lag states are not strictly stable.
        TypeError
            If it is no state-space system.
        """
        matrices = statespace.unpack(system)
        origin = getattr(system, "aero_rom", None)
        if isinstance(origin, AeroROM) and all(
            np.array_equal(getattr(origin, name), matrices[name]) for name in MATRICES
        ):
            base_motion = origin.base_motion if base_motion is None else base_motion
            base_load = origin.base_load if base_load is None else base_load
            provenance = origin.provenance if provenance is None else provenance
        elif provenance is None:
            provenance = Provenance(source=f"control.StateSpace {system.name!r}")
        return cls(**matrices, base_motion=base_motion, base_load=base_load, provenance=provenance)

    def __eq__(self, other: object) -> bool:
        """Return whether all arrays and the provenance are equal, value by value."""
        if not isinstance(other, AeroROM):
            return NotImplemented
        return self.provenance == other.provenance and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in ARRAYS
        )

    def __hash__(self) -> int:
        return hash((self.provenance, tuple(self.stiffness.ravel().tolist()), tuple(self.lag_state.ravel().tolist())))

    def __repr__(self) -> str:
        lines = [f"AeroROM: {self.n_modes} modes, {self.n_lags} lag states", f"  {self.provenance.facts}"]
        if self.n_lags:
            lines.append(f"  slowest pole {self.poles[0]:.4g}, fastest {self.poles[-1]:.4g}")
        if self.provenance.source:
            lines.append(f"  {self.provenance.source.splitlines()[0][:110]}")
        return "\n".join(lines)
