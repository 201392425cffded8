"""Where a generator of random numbers is, in words that a file can hold, and one that goes on from there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hbnlp.core.checks import refused
from hbnlp.core.layout import mapping, text

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
        If the one that is given is of another kind, or if there is none and the state is not of one of NumPy's.
    """
    kind = state["bit_generator"]
    if rng is None and kind in _KINDS:
        rng = np.random.Generator(_KINDS[kind]())
    elif rng is None or rng.bit_generator.state["bit_generator"] != kind:
        raise refused(ValueError, "rng", rng, f"a Generator of the kind that was drawn from before, {kind}")
    rng.bit_generator.state = dict(state)
    return rng


def read_state(value: Any) -> dict[str, Any]:
    """Return a state as `state_of` does, of what a file holds."""
    state = mapping(value)
    if text(state.get("bit_generator")) in _KINDS:
        at_state(state)
    return state


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
