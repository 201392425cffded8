"""Do one task at many points."""

from __future__ import annotations

import functools
import logging
import os
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from typing import Any

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.callbacks import Callbacks
from hbnlp.core.checks import file_name, instance_of, list_of_callables
from hbnlp.core.errors import SaveError
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.many import each_of
from hbnlp.core.tasks import COMPLETE, UNDER_WAY, Ending, Report, drive
from hbnlp.studies.outcomes import Failure, attempted
from hbnlp.studies.points import Points, Value
from hbnlp.studies.record import Study, study_of
from hbnlp.studies.storing import Folder, check_known, described

logger = logging.getLogger(__name__)


@interrupts_kept(returns=True)
def study(
    task: Callable[..., Any],
    *,
    over: Mapping[str, Sequence[Value]] | Sequence[Mapping[str, Value]],
    executor: Executor | None = None,
    folder: str | os.PathLike[str] | None = None,
    callbacks: Callbacks = (),
) -> Study:
    """Return the results of a task at all points of a grid, or of a list, in their order.

    Parameters
    ----------
    task : callable
        Called as ``task(at=point)`` with a dict of values by name, as the verbs of hbnlp are: one of these with the
        rest of its arguments, ``functools.partial(hbnlp.trace, problem, "omega", (0.3, 3.0))``, or a function
        ``def task(at)`` that makes what it needs of the values. What a partial has in its own ``at=`` stays, the
        point's values beside it.
    over : mapping of names to sequences, or sequence of mappings
        Values along each direction of a grid, whose last name varies fastest; or the points one by one. Numbers, texts,
        True and False.
    executor : concurrent.futures.Executor, optional
        Who does the work: a ``ProcessPoolExecutor``, the ``get_executor()`` of a Client of Dask, mpi4py's
        ``MPIPoolExecutor``. It is not shut down. The task is sent to each worker once. Results are those of a loop.
    folder : path-like, optional
        Where each result is written when it comes, records and errors alike, none as a pickle. What the folder of this
        study has already is not done again, but for errors, which are tried anew. Results are then records of hbnlp,
        numbers, texts, arrays, and lists, tuples and mappings of these.
    callbacks : sequence of callables
        Called after each point with a `Progress`, such as ``hbnlp.ProgressBar()``; one that raises `StopTracing` ends
        the study with what is done, as Ctrl-C does.

    Returns
    -------
    Study
        A point at which the task raises an error has this in ``study.errors``.

    Raises
    ------
    TypeError, ValueError
        For arguments of another kind, a task that cannot be sent or, with a folder, told from others, points that are
        none, a folder of another study.
    LoadError
        (A `ValueError`.) If the folder has other files and does not say of which study it is.
    RuntimeError
        If the executor is shut down.
    TaskError
        If the workers are gone, or a result cannot be written as what it is; its ``result`` is the study so far. Before
        the first point is done such an error is raised as it is.

    Notes
    -----
    What a task warns of, it warns of at each point, where it is done.
    """
    accepted = 'a function of at={"force": 0.1}, such as functools.partial(hbnlp.trace, problem, "omega", (0.3, 3.0))'
    instance_of("task", task, Callable, accepted)
    instance_of("executor", executor, Executor | None, "a concurrent.futures.Executor")
    list_of_callables("callbacks", callbacks)
    points = Points.of(over)
    about = described(task)
    if folder is not None:
        file_name("folder", folder)
        check_known(task, about)
    kept = None if folder is None else Folder(folder, about, points)
    found = {} if kept is None else kept.found(_problem_of(task))
    known = {i: outcome for i, outcome in found.items() if i < len(points.all) and not isinstance(outcome, Failure)}
    run = _Run(task, points, known, executor, kept)

    work = run.steps()

    def record(ending: Ending) -> Study:
        if ending is not UNDER_WAY:
            work.close()  # what has ended by now is done, and the rest is not waited for
        words = "" if ending is COMPLETE else f"{ending}: "
        return study_of(about, points, run.found, words)

    return drive("study", work, record, name="point", callbacks=callbacks)


class _Run:
    """A study under way."""

    def __init__(
        self,
        task: Callable[..., Any],
        points: Points,
        found: dict[int, Any],
        executor: Executor | None,
        kept: Folder | None,
    ) -> None:
        self.found = found
        self._task, self._points, self._executor, self._kept = task, points, executor, kept
        self._n_failed, self._failing = 0, False

    def steps(self) -> Generator[Report, None, None]:
        """Do what is left, and report after each point."""
        left = [i for i in range(len(self._points.all)) if i not in self.found]

        def take(place: int, outcome: Any) -> None:
            self._take(left[place], outcome)

        work = functools.partial(attempted, self._task)
        points = [self._points.all[i] for i in left]
        with closing(each_of(work, points, take, executor=self._executor)) as ended:
            for place in ended:
                done = len(self.found)
                yield Report(left[place], done / len(self._points.all), {"done": done, "failed": self._n_failed})

    def _take(self, number: int, outcome: Any) -> None:
        """Keep what came of a point; an error that never reached its task is a Failure, too."""
        if isinstance(outcome, BaseException):
            outcome = Failure.of(outcome)
        self._n_failed += isinstance(outcome, Failure)
        self.found[number] = outcome
        if self._kept is None:
            return
        try:
            self._kept.keep(number, outcome)
        except SaveError as error:  # what was computed is worth more than its file
            if not self._failing:
                logger.warning("the study goes on, though a result could not be saved: %s", error)
            self._failing = True
        else:
            self._failing = False


def _problem_of(task: Callable[..., Any]) -> HarmonicBalance | None:
    """Return the problem that a partial has among its arguments: that of its records, as a rule."""
    if not isinstance(task, functools.partial):
        return None
    given = [*task.args, *task.keywords.values()]
    return next((each for each in given if isinstance(each, HarmonicBalance)), None)
