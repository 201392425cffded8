"""Floquet multipliers: collocation of the linearised equations over a period."""

from typing import Any

from hbnlp.core.old_names import old_names
from hbnlp.core.renamed import renamed_name


def __getattr__(name: str) -> Any:
    raise renamed_name(__name__, name, old_names(__name__))
