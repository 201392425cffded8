"""Trace a branch from one end of a span to the other, with observers; nothing computed is ever lost."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.tracer import AWAY_FROM, DEFAULT_STABILITY, Tracer
from hbnlp.continuation.arclength import PseudoArclength
from hbnlp.core.callbacks import Callbacks
from hbnlp.core.checks import list_of_callables
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.kinds import End
from hbnlp.core.renamed import renamed_arguments
from hbnlp.core.tasks import INTERRUPTED, STOPPED, Ending, Report, drive
from hbnlp.solutions.events import EventFunction
from hbnlp.solutions.solution import Solution
from hbnlp.stability.result import Floquet

logger = logging.getLogger(__name__)


@renamed_arguments(problem="subject", away_from=AWAY_FROM)
@interrupts_kept(returns=True)
def trace(
    subject: HarmonicBalance | Solution,
    name: str,
    span: tuple[float, float],
    *,
    at: Mapping[str, float] | None = None,
    start: Solution | ArrayLike | None = None,
    direction: int = 1,
    stability: Floquet | None = DEFAULT_STABILITY,
    method: PseudoArclength | None = None,
    events: Mapping[str, EventFunction] | None = None,
    callbacks: Callbacks = (),
    resume: Branch | None = None,
) -> Branch:
    """Trace a branch of periodic solutions in one parameter, through its folds, with special points and stability.

    Parameters
    ----------
    subject : HarmonicBalance or Solution
        The problem; or a solution of it, where to begin within the span, at its parameters and away from its origin.
    name : str
        The continuation parameter.
    span : (float, float)
        Where to begin and where to end; a branch that comes back to its beginning ends there, and says so.
    at : mapping, optional
        Values of the other parameters. One of the continuation parameter itself, within the span, is where a cold start
        is made, or a ``start`` is solved again.
    start : Solution or array (n_dof, 2H+1), optional
        Where to begin within the span. By default a cold start at ``span[0]``, see `hbnlp.solve`. A solution that was
        switched to leads away from where it was switched.
    direction : 1 or -1
        Which way to go first from a start: towards the end of the span or away from it.
    stability : Floquet or None
        Options of the Floquet analysis of every point; None: off.
    method : PseudoArclength, optional
    events : mapping of names to functions, optional
        What to look for besides: ``{"amplitude 1": lambda s: s.amplitude_squared("x") - 1.0}``. A function gets the
        problem with the harmonics of a solution, and returns an expression of its ``x`` and ``p``; where that vanishes
        is a special point of the kind `Kind.EVENT`.
    callbacks : sequence of callables
        Called after each point with a `Progress`, such as `ProgressBar()` and `Autosave(path)`; one that raises
        `StopTracing` ends the trace.
    resume : Branch, optional
        Go on from the last point of this branch, from memory or a file; its events are to be given again.

    Returns
    -------
    Branch
        ``branch.end`` and ``branch.message`` say why it ended. Ctrl-C ends a trace as well, with the points so far.

    Raises
    ------
    ValueError, KeyError, TypeError
        For a span or name that cannot be, a singular mass matrix, or a branch that does not belong to the problem.
    ConvergenceError
        If the start does not converge.
    TaskError
        If an error is raised on the way; its ``result`` is the branch so far, its cause is the error.

    Warns
    -----
    LinearInstabilityWarning
        If the linear part of the system is unstable about rest.
    """
    list_of_callables("callbacks", callbacks)
    tracer = Tracer(
        subject,
        name,
        span,
        at=at,
        start=start,
        direction=direction,
        stability=stability,
        method=method,
        events=events,
        resume=resume,
    )
    reached = _Reached(tracer.span)

    def work() -> Iterator[Report]:
        for traced in tracer:
            value = traced.point.value
            yield Report(value, reached.at(value), {"points": tracer.n_points, "folds": tracer.n_folds})

    def result(ending: Ending) -> Branch:
        if ending.error is not None:
            return tracer.branch(End.ERROR, str(ending))
        return tracer.branch({INTERRUPTED: End.INTERRUPTED, STOPPED: End.STOPPED}.get(ending))

    warn_of = tracer.problem.system.warn_of
    branch = drive(f"tracing {name}", work(), result, name=name, callbacks=callbacks, warn_of=warn_of)
    if branch.end in (End.JUMP, End.STEP_TOO_SMALL, End.UNBOUNDED, End.CORNER, End.MAX_POINTS):
        logger.warning("the trace ended at %s = %.8g: %s", name, branch.parameter[-1], branch.message)
    return branch


class _Reached:
    """The part of the span that a trace has reached, of its logarithm where the span covers more than a decade."""

    def __init__(self, span: tuple[float, float]) -> None:
        self._span = span
        self._logarithmic = min(span) > 0.0 and max(span) > 10.0 * min(span)
        self.fraction = 0.0

    def at(self, value: float) -> float:
        """Return the largest part so far, this value included."""
        begin, end = self._span
        if self._logarithmic:
            part = float(np.log(value / begin) / np.log(end / begin))
        else:
            part = (value - begin) / (end - begin)
        self.fraction = max(self.fraction, part)
        return self.fraction
