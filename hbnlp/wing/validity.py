"""How far a motion of a wing may be believed: its camber, its strain, its frequencies and its incidence."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np

from hbnlp.aero import AeroROM
from hbnlp.core.checks import counted, real_number, refused
from hbnlp.core.errors import ValidityWarning
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.types import Array, BoolArray, ComplexArray
from hbnlp.core.warned import users_level
from hbnlp.fourier import basis_values, to_real
from hbnlp.wing.membrane import Membrane
from hbnlp.wing.strain import ExactArc

DEGREES = 0.8
"""Incidences larger than this, 46 degrees in rad, were probably meant in degrees."""
SAMPLES = 32
"""Samples a period and harmonic: the largest of them is at most half a percent below the largest value."""


@dataclass(frozen=True, kw_only=True)
class ValidityLimits:
    """Up to where a wing's motion is to be believed; the defaults are of the order at which models begin to differ.

    Parameters
    ----------
    camber : float
        Largest ``|w|`` in chords: the aerodynamics are linear in the displacement. Up to about a tenth the lift is
        within 2.1 % of coupled flow at Re = 100 (docs/paper.md).
    tension_error : float
        Relative error of the membrane's tension, against an elastic membrane of exact arc length.
    beyond_band : float
        Part of the membrane's accelerations at frequencies above the band to which the ROM was fitted.
    incidence : float
        Distance of the incidence from the ROM's, rad.
    """

    camber: float = 0.1
    tension_error: float = 0.05
    beyond_band: float = 0.1
    incidence: float = 0.2

    def __post_init__(self) -> None:
        for each in fields(self):
            real_number(each.name, getattr(self, each.name), above=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Validity(ReadOnlyArrays):
    """What speaks against believing motions of a wing, point by point, and the limits that it is judged by.

    Attributes
    ----------
    camber : array (n_points,)
        Largest ``|w|`` over the chord and the period, in chords.
    tension_error : array (n_points,)
        Largest relative difference over the period between the model's tension and ``2 Eh (delta0 + delta)`` with the
        exact arc's delta.
    beyond_band : array (n_points,)
        Root-mean-square share of the membrane's accelerations at frequencies above the ROM's band; zero where the ROM
        has none. Below the band it goes to the static value, which is exact.
    incidence : array (n_points,)
        Largest distance of the incidence from the ROM's over the period, rad.
    limits : ValidityLimits
    """

    camber: Array = field(repr=False)
    tension_error: Array = field(repr=False)
    beyond_band: Array = field(repr=False)
    incidence: Array = field(repr=False)
    limits: ValidityLimits

    def __len__(self) -> int:
        return int(self.camber.size)

    @property
    def within(self) -> BoolArray:
        """Whether each point is within all limits, (n_points,)."""
        return np.asarray(np.all([values <= limit for _, values, limit in self._measures()], axis=0))

    @property
    def reasons(self) -> tuple[str, ...]:
        """Which limits are exceeded, at how many points and by how much; empty where none is."""
        reasons = []
        for name, values, limit in self._measures():
            beyond = int(np.count_nonzero(values > limit))
            if beyond:
                most = f"up to {values.max():.3g} (limit {limit:g})"
                reasons.append(f"{_WORDS[name]} {most} at {counted(beyond, 'point')}")
        if np.any(self.incidence > DEGREES):
            most = f"{self.incidence.max():.3g} rad"
            reasons.append(f"an incidence of {most} looks like degrees: give numpy.radians(...)")
        return tuple(reasons)

    def warn(self) -> None:
        """Give one ValidityWarning with all reasons; none where there is no reason."""
        if self.reasons:
            said = f"beyond the model: {'; '.join(self.reasons)}; see wing.validity(...), and limits= of membrane_wing"
            warnings.warn(said, ValidityWarning, stacklevel=users_level())

    def _measures(self) -> list[tuple[str, Array, float]]:
        return [(each.name, getattr(self, each.name), getattr(self.limits, each.name)) for each in fields(self.limits)]

    def __repr__(self) -> str:
        state = "; ".join(self.reasons) or "all within the limits"
        return (
            f"Validity of {counted(len(self), 'point')}, {np.count_nonzero(self.within)} within all limits\n  {state}"
        )


_WORDS = {
    "camber": "camber",
    "tension_error": "an error of the tension",
    "beyond_band": "a share of accelerations beyond the ROM's band",
    "incidence": "incidence from the ROM's, in rad,",
}


class Motion(Protocol):
    """What is needed of a periodic solution of a wing."""

    @property
    def coefficients(self) -> Array:
        """Of the modal amplitudes, (N, 2H+1)."""

    @property
    def parameters(self) -> Any:
        """All values by name."""

    @property
    def periods(self) -> int:
        """Its length in periods of the forcing."""

    def harmonics(self, output: str) -> ComplexArray:
        """Return the harmonics (H+1,) of an output."""


def validity(membrane: Membrane, rom: AeroROM, record: Any, limits: ValidityLimits) -> Validity:
    """Return what speaks against believing a solution, or each point of a branch or sweep, of a wing of these two.

    Parameters
    ----------
    membrane : Membrane
    rom : AeroROM
    record : Solution or a sequence of them, Branch, Sweep or any record with ``solution(i)``, or Diagram
        The points of a diagram's branches stand one branch after another.
    limits : ValidityLimits

    Raises
    ------
    TypeError
        If the record is something else.
    ValueError
        If it is of another system.
    """
    if hasattr(record, "branches"):
        parts = [validity(membrane, rom, branch, limits) for branch in record.branches]
        columns = {name: [np.zeros(0), *(getattr(part, name) for part in parts)] for name in _WORDS}
        return Validity(**{name: np.concatenate(each) for name, each in columns.items()}, limits=limits)
    if hasattr(record, "solution"):
        motions = [record.solution(i) for i in range(len(record))]
    elif hasattr(record, "coefficients") and hasattr(record, "harmonics"):
        motions = [record]
    elif isinstance(record, Sequence) and not isinstance(record, str):
        motions = list(record)
    else:
        raise refused(TypeError, "record", record, "a Solution, Branch, Sweep or Diagram of the wing")
    for motion in motions[:1]:
        if motion.coefficients.shape[0] != membrane.n_modes or "alpha" not in motion.output_names:
            raise ValueError(
                f"the record is of another system than a wing of {membrane.n_modes} modes; give one of this"
            )
    measures = np.array([_measured(membrane, rom, motion) for motion in motions]).reshape(-1, 4)
    camber, tension_error, beyond_band, incidence = measures.T
    return Validity(
        camber=camber,
        tension_error=tension_error,
        beyond_band=beyond_band,
        incidence=incidence,
        limits=limits,
    )


def _measured(membrane: Membrane, rom: AeroROM, motion: Motion) -> tuple[float, float, float, float]:
    """Return camber, error of the tension, share beyond the band and incidence of one motion."""
    n_harmonics = motion.coefficients.shape[1] // 2
    basis = basis_values(2.0 * np.pi * np.arange(SAMPLES * n_harmonics) / (SAMPLES * n_harmonics), n_harmonics)
    shapes = motion.coefficients @ basis.T
    incidence = basis @ to_real(motion.harmonics("alpha"))
    return (
        _camber(membrane, shapes),
        _tension_error(membrane, motion, shapes),
        _beyond_band(rom, motion),
        float(np.abs(incidence - rom.provenance.incidence).max()),
    )


def _camber(membrane: Membrane, shapes: Array) -> float:
    """Return the largest camber of shapes (N, n_times), to half a percent: that of the highest one at some nodes."""
    nodes = np.linspace(0.0, 1.0, 16 * membrane.n_modes + 1)
    heights = membrane.displacement(shapes, nodes)
    highest = np.maximum(heights.max(axis=0), -heights.min(axis=0)).argmax()
    return float(membrane.camber(shapes[:, highest]))


def _tension_error(membrane: Membrane, motion: Motion, shapes: Array) -> float:
    p = SimpleNamespace(**{name: motion.parameters[name] for name in ("mass_ratio", "stiffness", "prestrain")})
    arc = ExactArc(membrane.wave_numbers, max(64, 8 * membrane.n_modes))
    tension = np.ravel(membrane.tension(shapes, p))
    exact = 2.0 * p.stiffness * (p.prestrain + np.ravel(arc.elongation(shapes)))
    smallest = float(np.finfo(float).tiny)
    return float(np.max(np.abs(tension - exact) / np.maximum(exact, smallest)))


def _beyond_band(rom: AeroROM, motion: Motion) -> float:
    if rom.provenance.band is None:
        return 0.0
    a = motion.coefficients[:, 1:]
    number = np.arange(1, a.shape[1] // 2 + 1)
    squared = number**4 * np.sum(a[:, ::2] ** 2 + a[:, 1::2] ** 2, axis=0)
    above = number * motion.parameters["omega"] / motion.periods > rom.provenance.band[1] * (1.0 + 1e-9)
    total = float(squared.sum())
    return float(np.sqrt(squared[above].sum() / total)) if total > 0.0 else 0.0
