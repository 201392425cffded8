"""What objects leave behind when they are pickled or copied, and those that stay in their process."""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar, NoReturn

import numpy as np


class FieldsAlone:
    """A frozen dataclass of which the fields are sent, and not what has been computed from them and kept."""

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}  # type: ignore[arg-type]


class ReadOnlyArrays:
    """A frozen record whose arrays and mappings cannot be written to, nor where they arrive.

    What reads them gives them away as they are: a user who writes ``omega = branch.values("omega"); omega /= 2 * pi``
    would change the branch.
    """

    def __post_init__(self) -> None:
        for name, value in [*vars(self).items()]:
            if isinstance(value, np.ndarray):
                view = value.view()  # whoever made the array may go on writing to it
                view.flags.writeable = False
                object.__setattr__(self, name, view)
            elif type(value) is dict:
                object.__setattr__(self, name, FixedDict(value))

    def __setstate__(self, state: dict[str, Any]) -> None:
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        self.__dict__.update(state)


class FixedDict(dict[Any, Any]):
    """A dictionary that cannot be changed; ``dict(fixed)`` and ``{**fixed, name: value}`` can."""

    def _refused(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError("a record cannot be changed; take a copy, such as {**solution.parameters, 'omega': 1.0}")

    __setitem__ = __delitem__ = __ior__ = update = setdefault = pop = popitem = clear = _refused

    def __reduce__(self) -> tuple[type[FixedDict], tuple[dict[Any, Any]]]:
        return FixedDict, (dict(self),)


class StaysHere:
    """What cannot be sent or copied, for instance because it shares symbols with objects beside it."""

    _instead: ClassVar[str]

    def __reduce__(self) -> NoReturn:
        raise TypeError(f"a {type(self).__name__} cannot be pickled or copied: {self._instead}")
