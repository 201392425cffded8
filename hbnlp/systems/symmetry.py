"""A symmetry: a matrix and a shift of the phase that take motions to motions, and the group that several generate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby

import numpy as np

from hbnlp.core.checks import instance_of, real_number, refused, whole_number
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.types import Array

PERIOD = 2.0 * np.pi
LARGEST_GROUP = 64
"""Elements of the group that the symmetries of a user may generate."""
DECIMALS = 9
"""To which two symmetries are told apart: products of matrices are known to rounding."""


@dataclass(frozen=True, eq=False, repr=False)
class Symmetry(ReadOnlyArrays):
    """What takes a motion ``q(tau)`` to another motion, ``matrix @ q(tau + shift)``.

    Two of them are equal if matrix and shift are, to nine decimals; the name does not count.

    Parameters
    ----------
    matrix : array (n_dof, n_dof)
        Invertible, and some power of it is the identity: a permutation of equal parts, a reflection, a rotation. It
        need not be orthogonal: an isometry of the mass matrix will do, in whatever coordinates.
    shift : float
        Of the forcing phase tau, a fraction of ``2 pi``: ``pi`` is half a forcing period.
    name : str
        By which special points and images tell it.

    Raises
    ------
    ValueError
        For a matrix that is not square, not finite or singular, or a shift that is not finite.
    TypeError
        For a shift that is no number, or a name that is no text.

    Examples
    --------
    >>> Symmetry([[0, 1], [1, 0]], name="swap")
    Symmetry 'swap' of 2 degrees of freedom
    >>> Symmetry(-np.eye(2), shift=np.pi, name="mirror")
    Symmetry 'mirror' of 2 degrees of freedom, phase shifted by 0.5 periods
    """

    matrix: Array
    shift: float = field(default=0.0, kw_only=True)
    name: str = field(default="symmetry", kw_only=True)

    def __post_init__(self) -> None:
        instance_of("name", self.name, str, "a text")
        try:
            matrix = np.array(self.matrix, dtype=float, ndmin=2)
        except (TypeError, ValueError, OverflowError, RuntimeError):
            raise refused(TypeError, "matrix", self.matrix, "an array of real numbers, (n_dof, n_dof)") from None
        if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not matrix.size:
            raise ValueError(
                f"the matrix of symmetry {self.name!r} has shape {matrix.shape}; give a square one, (n_dof, n_dof)"
            )
        finite = bool(np.all(np.isfinite(matrix)))
        if not finite or np.linalg.slogdet(matrix)[0] == 0.0:
            raise ValueError(
                f"the matrix of symmetry {self.name!r} is {'singular' if finite else 'not finite'}; give one that can "
                "be undone, such as a permutation or a reflection"
            )
        matrix.setflags(write=False)
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "shift", real_number(f"shift of symmetry {self.name!r}", self.shift))

    @classmethod
    def identity(cls, n_dof: int) -> Symmetry:
        """Return what takes every motion to itself."""
        return cls(np.eye(whole_number("n_dof", n_dof, least=1, most=10_000)), name="identity")

    @property
    def n_dof(self) -> int:
        """Number of degrees of freedom."""
        return int(self.matrix.shape[0])

    @property
    def is_identity(self) -> bool:
        """Whether it takes every motion to itself."""
        return round(self.shift, DECIMALS) == 0.0 and np.array_equal(
            np.round(self.matrix, DECIMALS), np.eye(self.n_dof)
        )

    def __eq__(self, other: object) -> bool:
        return self._key == other._key if isinstance(other, Symmetry) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[int, float, tuple[float, ...]]:
        entries = np.round(self.matrix, DECIMALS) + 0.0  # no -0
        return self.n_dof, round(self.shift, DECIMALS) + 0.0, tuple(entries.ravel().tolist())

    def __repr__(self) -> str:
        shifted = f", phase shifted by {self.shift / PERIOD:.6g} periods" if self.shift else ""
        return f"Symmetry {self.name!r} of {self.n_dof} degree{'s' if self.n_dof > 1 else ''} of freedom{shifted}"


def inherent(n_dof: int) -> tuple[Symmetry, ...]:
    """Return what a system is asked for by itself: the change of sign with half a period, without it, and that alone.

    Cosines of tau alone have the first; parametric excitation at twice the frequency has all three.
    """
    sign, half = -np.eye(n_dof), PERIOD / 2.0
    return (
        Symmetry(sign, shift=half, name="half-period sign change"),
        Symmetry(sign, name="sign change"),
        Symmetry(np.eye(n_dof), shift=half, name="half period"),
    )


def of_size(symmetry: Symmetry, n_dof: int) -> Symmetry:
    """Return a symmetry, or raise an error if it is none or of another number of degrees of freedom."""
    instance_of("symmetry", symmetry, Symmetry, "an hbnlp.Symmetry(matrix)")
    if symmetry.n_dof != n_dof:
        raise ValueError(
            f"the matrix of symmetry {symmetry.name!r} has shape {symmetry.matrix.shape}; for this system give one of "
            f"shape ({n_dof}, {n_dof})"
        )
    return symmetry


def group(symmetries: Sequence[Symmetry], n_dof: int) -> tuple[Symmetry, ...]:
    """Return the group of what a user names and of what is `inherent`, without the identity.

    The user's own come first, then the inherent ones, then products of the user's, then those with the inherent ones;
    shifts lie within one period.

    Raises
    ------
    ValueError
        If the user's alone have more than 64 elements: their group is large, or has no end.
    """
    own, by_itself = _generated(symmetries, n_dof), inherent(n_dof)
    products = [_product(element, other) for element in own for other in by_itself]
    elements = [*own[: len(symmetries)], *by_itself, *own[len(symmetries) :], *products]
    return tuple(element for element in dict.fromkeys(elements) if not element.is_identity)


def _generated(symmetries: Sequence[Symmetry], n_dof: int) -> list[Symmetry]:
    """Return the group of these, one product longer than the other, without the identity."""
    identity = Symmetry.identity(n_dof)
    words: dict[Symmetry, tuple[str, ...]] = {identity: ()}
    newest = [identity]
    while newest:
        longer = [(_product(each, last), (each.name, *words[last])) for last in newest for each in symmetries]
        newest = []
        for element, word in longer:
            if element not in words:
                words[element] = word
                newest.append(element)
        if len(words) > LARGEST_GROUP:
            raise ValueError(
                f"the symmetries {', '.join(repr(each.name) for each in symmetries)} generate more than "
                f"{LARGEST_GROUP} elements; give matrices of which a low power is the identity and shifts by simple "
                "fractions of 2 pi, or fewer of them"
            )
    return [replace(element, name=_named(word)) for element, word in words.items() if word]


def _product(last: Symmetry, first: Symmetry) -> Symmetry:
    """Return what does ``first``, then ``last``, its shift within one period."""
    shift = (last.shift + first.shift) % PERIOD
    if min(shift, PERIOD - shift) < 0.1**DECIMALS:
        shift = 0.0
    return Symmetry(last.matrix @ first.matrix, shift=shift, name=f"{last.name} with {first.name}")


def _named(words: tuple[str, ...]) -> str:
    runs = [(word, len(list(run))) for word, run in groupby(words)]
    return " with ".join(word if times == 1 else f"{word} {times} times" for word, times in runs)
