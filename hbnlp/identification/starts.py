"""One identification from several starts, here or by the workers of an executor: which of them came to the best fit."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import Any

from hbnlp.core.many import each_of
from hbnlp.identification.rounds import Outcome, Rounds, Task

logger = logging.getLogger(__name__)


def best_of(
    task: Task, starts: Sequence[Mapping[str, float]], executor: Executor | None
) -> tuple[Outcome, tuple[Mapping[str, float] | None, ...]]:
    """Return the best outcome, the first of equal ones, and the values that each start led to, None where it failed.

    They are compared by the sum of squared residuals, those beyond the threshold counting as that, in units of the
    smallest standard deviation of any.

    Raises
    ------
    Exception
        What the first start raised, if all failed; that others failed is logged.
    """
    ended: dict[int, Any] = {}
    for _ in each_of(partial(_from_start, task), starts, ended.__setitem__, executor=executor):
        pass
    all_ended = [ended[i] for i in range(len(starts))]
    outcomes = [each for each in all_ended if isinstance(each, Outcome)]
    if not outcomes:
        raise all_ended[0]
    for number, each in enumerate(all_ended):
        if not isinstance(each, Outcome):
            logger.warning("start[%d] led nowhere: %s: %s", number, type(each).__name__, each)
    scale = min(outcome.fitted.scale for outcome in outcomes)
    best = min(outcomes, key=lambda outcome: task.cost(outcome.fitted, scale))
    return best, tuple(each.fitted.found.values if isinstance(each, Outcome) else None for each in all_ended)


def _from_start(task: Task, start: Mapping[str, float]) -> Outcome | Exception:
    try:
        return Rounds(task).until_settled(start)
    except Exception as error:  # noqa: BLE001 - another start may do better
        return error
