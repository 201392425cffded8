"""Whether the terms of a system are of the right kinds and belong together, before any is evaluated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from hbnlp.core.checks import instance_of, refused, text


def check_functions(force: Any, forcing: Any, motion: Any, outputs: Any) -> None:
    """Raise a TypeError that names the first of what are to be functions and is none."""
    for name, law, arguments in (
        ("nonlinear_force", force, "(q, v, tau, p)"),
        ("forcing", forcing, "(tau, p)"),
        ("motion", motion, "(tau, p)"),
    ):
        instance_of(name, law, Callable | None, f"a function of {arguments}, or None")
    instance_of("outputs", outputs, Mapping | None, "a mapping of names to functions, {'x': lambda s: s.q[0]}")
    for name, output in (outputs or {}).items():
        text("a name of outputs", name)
        instance_of(f"outputs[{name!r}]", output, Callable, "a function of s, such as lambda s: s.q[0]")


def check_inputs(motion: Any, inputs: Mapping[str, Any]) -> None:
    """Raise a ValueError for the matrices of a motion without it."""
    given = next((name for name, matrix in inputs.items() if matrix is not None), None)
    if motion is None and given is not None:
        raise refused(ValueError, "motion", motion, f"the motion that {given} multiplies, or leave {given} out")


def check_motion(motion: Any, inputs: Mapping[str, Any], outputs: Any) -> None:
    """Raise a ValueError for a motion that acts on nothing and is in no output."""
    if motion is not None and outputs is None and all(matrix is None for matrix in inputs.values()):
        raise refused(ValueError, "motion", motion, f"what it acts through as well, one of {', '.join(inputs)}")


def check_lags(lag_state: Any, lag_input: Any, lag_motion: Any, lag_output: Any) -> None:
    """Raise a ValueError for lag states that nothing moves, or that move nothing."""
    if lag_state is None:
        for name, matrix in (("lag_input", lag_input), ("lag_motion", lag_motion), ("lag_output", lag_output)):
            if matrix is not None:
                raise refused(ValueError, "lag_state", lag_state, f"the matrix of lag states, or leave {name} out")
        return
    if lag_output is None:
        raise refused(ValueError, "lag_output", lag_output, "what the lag states act through, or leave lag_state out")
    if lag_input is None and lag_motion is None:
        raise refused(ValueError, "lag_input", lag_input, "what moves the lag states, or leave lag_state out")
