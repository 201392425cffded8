"""Where a generator of random numbers is, in words that a file can hold, and one that goes on from there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hbnlp.core.checks import refused

_KINDS = {
    each.__name__: each
    for each in (np.random.PCG64, np.random.PCG64DXSM, np.random.MT19937, np.random.Philox, np.random.SFC64)
}


def state_of(rng: np.random.Generator) -> dict[str, Any]:
    """Return where a generator is, in plain values."""
    return dict(_plain(rng.bit_generator.state))


def at_state(state: Mapping[str, Any], rng: np.random.Generator | None = None) -> np.random.Generator:
    """Return a generator that goes on from a state: a new one, or the one that is given, set to it.

    Raises
    ------
    ValueError
        If the one that is given is of another kind, or if there is none and no state of a generator of NumPy.
    """
    kind = state.get("bit_generator")
    if rng is None and kind not in _KINDS:
        raise ValueError(f"{kind!r} is no generator of NumPy")
    if rng is None:
        rng = np.random.Generator(_KINDS[str(kind)]())
    elif rng.bit_generator.state["bit_generator"] != kind:
        raise refused(ValueError, "rng", rng, f"one of the kind of the search that goes on, {kind}, or none")
    rng.bit_generator.state = dict(state)
    return rng


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
