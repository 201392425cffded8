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
    """A frozen record whose arrays cannot be written to, nor where they arrive."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        self.__dict__.update(state)


class StaysHere:
    """What cannot be sent or copied, for instance because it shares symbols with objects beside it."""

    _instead: ClassVar[str]

    def __reduce__(self) -> NoReturn:
        raise TypeError(f"a {type(self).__name__} cannot be pickled or copied: {self._instead}")
