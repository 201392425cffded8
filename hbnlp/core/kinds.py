"""Enumerations: what happens at a point, why a branch ends, what became of a solve."""

from __future__ import annotations

import enum

from hbnlp.core.checks import refused


class Status(enum.Enum):
    """What became of a solve; the text carries the remedy."""

    CONVERGED = "converged"
    NOT_CONVERGED = (
        "not converged: try another start (a neighbouring solution), fewer harmonics first, or method=hbnlp.Ipopt()"
    )


class Kind(enum.Enum):
    """What happens at a special point; `code` has the letters by which AUTO and MatCont call it."""

    FOLD = "fold"
    BRANCH_POINT = "branch point"
    PERIOD_DOUBLING = "period doubling"
    NEIMARK_SACKER = "Neimark-Sacker"
    HOPF = "Hopf"
    PEAK = "peak"
    EVENT = "event"

    @property
    def code(self) -> str:
        """LP, BP, PD, NS, HB; EP for a peak, an extreme point; UZ for an event of the user."""
        return _CODES[self][0]

    @classmethod
    def of(cls, kind: Kind | str) -> Kind:
        """Return a kind by its word ("fold") or by a code, in small or capital letters.

        LP, BP, PD, NS (TR in AUTO), HB (H in MatCont), EP and UZ are known.

        Raises
        ------
        ValueError
            If there is no such kind.
        """
        if isinstance(kind, cls):
            return kind
        for each, codes in _CODES.items():
            if isinstance(kind, str) and kind.casefold() in {each.value.casefold(), *(c.casefold() for c in codes)}:
                return each
        known = ", ".join(f"{each.value!r} ({' or '.join(codes)})" for each, codes in _CODES.items())
        raise refused(ValueError, "kind", kind, f"a Kind, or one of {known}")


_CODES = {
    Kind.FOLD: ("LP",),
    Kind.BRANCH_POINT: ("BP",),
    Kind.PERIOD_DOUBLING: ("PD",),
    Kind.NEIMARK_SACKER: ("NS", "TR"),
    Kind.HOPF: ("HB", "H"),
    Kind.PEAK: ("EP",),
    Kind.EVENT: ("UZ",),
}


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
    UNBOUNDED = (
        "the motion grows without bound while the parameter stands still, as that of a linear system does at resonance "
        "or at a threshold of parametric excitation; a start on the far side may go on"
    )
    CORNER = "the force is not smooth on the motion, a step, a corner or nearly as steep: round it over a width"
    MET = "came back to the branch that it crosses"
    INTERRUPTED = "interrupted; resume it"
    ERROR = "an error was raised"
    STOPPED = "stopped by a callback; resume it"

    @property
    def complete(self) -> bool:
        """Whether all that was asked for is there: the branch came to an end of the span, closed, or met another."""
        return self in (End.SPAN_END, End.SPAN_START, End.CLOSED, End.MET)


class FoldEvent(enum.Enum):
    """What happens to the response where a fold curve is stationary in its second parameter."""

    CUSP = "cusp"
    ISOLA_BIRTH = "isola birth"
    ISOLA_MERGE = "isola merge"

    @classmethod
    def of(cls, kind: FoldEvent | str) -> FoldEvent:
        """Return an event by its word; a ValueError names those that are known."""
        for each in cls:
            if kind is each or (isinstance(kind, str) and kind == each.value):
                return each
        raise refused(ValueError, "kind", kind, f"a FoldEvent, or one of {', '.join(repr(each.value) for each in cls)}")
