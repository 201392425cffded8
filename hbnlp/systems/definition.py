"""What a system consists of once the user's functions have been called: numbers, names and small CasADi functions."""

from __future__ import annotations

import lzma
import pickle
from dataclasses import dataclass

import casadi as ca

from hbnlp.core.kept import built_once
from hbnlp.core.quantities import Quantities
from hbnlp.core.sending import FieldsAlone
from hbnlp.core.types import Array
from hbnlp.systems.parameters import ParameterSet
from hbnlp.systems.symmetry import Symmetry


@dataclass(frozen=True, kw_only=True, eq=False)
class Definition(FieldsAlone):
    """All that a `System` is built from, without symbols and without anything of the user's that is Python.

    It is what goes to another process. A system takes its expressions from here also where it was made from a user's
    functions, so that both have the same operations in the same order, and give the same numbers to the last bit.

    Attributes
    ----------
    name : str
    parameters : ParameterSet
    output_names : tuple of str
    lag_state, lag_input, lag_motion : arrays (m, m), (m, n), (m, n_u)
    matrices : casadi.Function
        p -> (M, D, K, L_x, K_u, D_u, M_u), as sparse as the user wrote them.
    force : casadi.Function
        (q, q', tau, p) -> f.
    signals : casadi.Function
        (tau, p) -> (forcing, u).
    outputs : casadi.Function
        (q, q', q'', x, tau, p) -> all outputs in the order of their names.
    symmetries : tuple of Symmetry
        Those of the user.
    angles : tuple of int
        Numbers of the displacements that count modulo 2 pi.
    quantities : Quantities
    """

    name: str
    parameters: ParameterSet
    output_names: tuple[str, ...]
    lag_state: Array
    lag_input: Array
    lag_motion: Array
    matrices: ca.Function
    force: ca.Function
    signals: ca.Function
    outputs: ca.Function
    symmetries: tuple[Symmetry, ...]
    angles: tuple[int, ...]
    quantities: Quantities

    @built_once
    def content(self) -> bytes:
        """The definition as bytes, some tens of kilobytes for a wing; a TypeError if it would not arrive."""
        for what in ("matrices", "force", "signals", "outputs"):
            if getattr(self, what).find_functions():
                self._check_arrival(what)
        # CasADi writes two letters a byte and eight bytes an index: compressed, a twelfth is left
        return lzma.compress(pickle.dumps(self, protocol=5), preset=0)

    def _check_arrival(self, what: str) -> None:
        # CasADi writes a Callback without a word, and fails to read it: in the worker, which ends with its pool
        try:
            ca.Function.deserialize(getattr(self, what).serialize())
        except RuntimeError as error:
            raise TypeError(
                f"system {self.name!r} cannot be pickled or copied: its {what} cannot be rebuilt from what CasADi "
                "writes of it, as where a casadi.Callback is called, which is Python of this process; write it in "
                "CasADi's operations, or make the system in the worker"
            ) from error

    @classmethod
    def of(cls, content: bytes) -> Definition:
        """Return the definition that has this content, and passes it on as it came: it is known by it."""
        definition: Definition = pickle.loads(lzma.decompress(content))  # noqa: S301 (part of a pickle already)
        vars(definition)["content"] = content
        return definition
