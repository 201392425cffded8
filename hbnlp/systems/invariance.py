"""What a system knows about itself: the symmetries it has at parameter values, and which displacements are angles."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import cast

import casadi as ca
import numpy as np

from hbnlp.core.checks import unknown_name, whole_number
from hbnlp.core.kept import built_once
from hbnlp.core.types import Array
from hbnlp.systems.equivariance import Equivariance
from hbnlp.systems.expressions import displacements
from hbnlp.systems.parameters import ParameterSet
from hbnlp.systems.symmetry import Symmetry, group, of_size


class Invariance:
    """The symmetries and angles of one system, named and found.

    Parameters
    ----------
    equivariance : Equivariance
    parameters : ParameterSet
    named : tuple of Symmetry
        Those of the user.
    """

    def __init__(self, equivariance: Equivariance, parameters: ParameterSet, named: tuple[Symmetry, ...]) -> None:
        self._equivariance, self._parameters, self._named = equivariance, parameters, named

    def at(self, at: Mapping[str, float] | Array | None) -> tuple[Symmetry, ...]:
        """Return the symmetries at parameter values, by name or all in order, without the identity."""
        terms = self._equivariance.at(self._values(at))
        return tuple(symmetry for symmetry in self._candidates if terms.lack_of(symmetry) is None)

    def has(self, symmetry: Symmetry, at: Mapping[str, float] | Array) -> bool:
        """Return whether the equations have a symmetry at parameter values, by name or all in order."""
        return self._equivariance.at(self._values(at)).lack_of(symmetry) is None

    def check(self, symmetry: Symmetry, at: Mapping[str, float] | Array | None = None) -> None:
        """Raise a ValueError that says in which term, and by how much, the equations lack a symmetry at parameters."""
        values = self._values(at)
        lack = self._equivariance.at(values).lack_of(of_size(symmetry, self._equivariance.n_dof))
        if lack is not None:
            raise ValueError(
                f"the system does not have the symmetry {symmetry.name!r}: {lack} at {self._in_words(values)}; correct "
                f"its matrix or its shift ({symmetry.shift:.6g}, where 2 pi is a period of the forcing), or leave it "
                "out (system.symmetries_at(...) tells those that there are)"
            )

    def check_given(self, angles: tuple[int, ...]) -> None:
        """Raise a ValueError for a named symmetry or an angle that the equations lack at the default parameters."""
        values = self._parameters.ordered(self._parameters.defaults)
        for symmetry in self._named:
            self.check(symmetry, values)
        values = self._values(values)
        for dof in angles:
            lack = self._equivariance.at(values).lack_of_turn(dof)
            if lack is not None:
                raise ValueError(
                    f"displacement {dof} is no angle, its turn by 2 pi changes the equations: {lack} at "
                    f"{self._in_words(values)}; leave it out of angles, or, if angles only turn together, take their "
                    "differences as coordinates"
                )
        _ = self._candidates  # a group without end is refused here

    @built_once
    def _candidates(self) -> tuple[Symmetry, ...]:
        return group(self._named, self._equivariance.n_dof)

    def _values(self, at: Mapping[str, float] | Array | None) -> Array:
        """Return all values in order, 1 where there is none."""
        inside = isinstance(at, np.ndarray) and at.shape == (len(self._parameters.names),) and at.dtype == float
        values = at if inside else self._parameters.values(cast("Mapping[str, float] | None", at), but=("omega",))
        complete: Array = np.nan_to_num(np.array(values, dtype=float), nan=1.0)
        return complete

    def _in_words(self, values: Array) -> str:
        return ", ".join(f"{name} = {value:g}" for name, value in self._parameters.as_dict(values).items())


def list_of_symmetries(given: Sequence[Symmetry], n_dof: int) -> tuple[Symmetry, ...]:
    """Return what a user gives as symmetries of a system, checked.

    Raises
    ------
    TypeError
        If it is no sequence of symmetries.
    ValueError
        If one is of another number of degrees of freedom, two are one, or two have one name.
    """
    if not isinstance(given, Sequence) or not all(isinstance(each, Symmetry) for each in given):
        raise TypeError(f"symmetries is {given!r}; give a list, [hbnlp.Symmetry(matrix)], also for a single one")
    for one, other in itertools.combinations(given, 2):
        if one == other:
            raise ValueError(f"symmetries: {one.name!r} and {other.name!r} are the same; give it once")
        if one.name == other.name:
            raise ValueError(f"symmetries: two are named {one.name!r}; give each a name= of its own")
    return tuple(of_size(each, n_dof) for each in given)


def angle_positions(given: Sequence[str | int], names: Mapping[str, int], n_dof: int) -> tuple[int, ...]:
    """Return the numbers of the displacements that a user gives as angles, in order, each once.

    Raises
    ------
    TypeError
        If it is no sequence.
    KeyError
        For a name of no displacement.
    ValueError
        For a number that no displacement has.
    """
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise TypeError(f"angles is {given!r}; give a list of names or numbers of displacements, also for a single one")
    positions = set()
    for angle in given:
        if isinstance(angle, str):
            if angle not in names:
                raise KeyError(f"angles: {unknown_name('displacement', angle, names)}")
            positions.add(names[angle])
        else:
            positions.add(whole_number("an entry of angles", angle, least=0, most=n_dof - 1, advice=", or a name"))
    return tuple(sorted(positions))


def names_of_displacements(outputs: ca.Function, output_names: Sequence[str]) -> dict[str, int]:
    """Return the positions of the displacements by name: x, or x1, x2, ..., and outputs that are one of them."""
    q = ca.SX.sym("q", outputs.size1_in(0))
    values = outputs(q, *(ca.SX.zeros(outputs.size1_in(k)) for k in range(1, outputs.n_in())))
    names = {name: i for i, name in enumerate(displacements(q.numel()))}
    for k, name in enumerate(output_names):
        for i in range(q.numel()):
            if ca.is_equal(values[k], q[i]):
                names[name] = i
    return names
