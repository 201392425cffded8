"""Enumerations: what happens at a point, why a branch ends, what became of a solve."""

import enum


class Status(enum.Enum):
    """What became of a solve; the text carries the remedy."""

    CONVERGED = "converged"
    NOT_CONVERGED = (
        "not converged: try another guess (a neighbouring solution), fewer harmonics first, or method=hbnlp.Ipopt()"
    )


class Kind(enum.Enum):
    """What happens at a special point."""

    FOLD = "fold"
    BRANCH_POINT = "branch point"
    PERIOD_DOUBLING = "period doubling"
    NEIMARK_SACKER = "Neimark-Sacker"
    PEAK = "peak"


class End(enum.Enum):
    """Why a branch ends."""

    SPAN_END = "reached the end of the span"
    SPAN_START = "reached the start of the span"
    CLOSED = "closed on itself"
    MAX_POINTS = "reached max_points; resume it, with a larger max_points"
    STEP_TOO_SMALL = (
        "the corrector fails however small the step; try more harmonics or a tighter PseudoArclength(angle=...)"
    )
    JUMP = (
        "every step, however small, would jump to another branch or turn back; another start on the far side may go on"
    )
    INTERRUPTED = "interrupted; resume it"
    ERROR = "an error was raised"
    STOPPED = "stopped by a callback; resume it"


class FoldEvent(enum.Enum):
    """What happens to the response where a fold curve is stationary in its second parameter."""

    CUSP = "cusp"
    ISOLA_BIRTH = "isola birth"
    ISOLA_MERGE = "isola merge"
