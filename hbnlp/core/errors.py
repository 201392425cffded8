"""Errors and warnings that carry what was computed before they were raised."""

from __future__ import annotations

import re
from typing import Any

from hbnlp.core.renamed import renamed_name


class HbnlpError(Exception):
    """Base class of the errors that hbnlp raises for reasons other than a wrong argument.

    They can be pickled with all that they carry, whatever their constructors ask for. Python drops the cause of an
    error that is pickled: a note names it then.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        """Send the message, the attributes and the notes, and the cause as a note."""
        state = self.__dict__.copy()
        if self.__cause__ is not None:
            cause = f"caused by {type(self.__cause__).__name__}: {self.__cause__}"
            state["__notes__"] = [*state.get("__notes__", ()), cause]
        # an OSError has arguments beside those in args
        return restored, (type(self), super().__reduce__()[1], state)


class ConvergenceError(HbnlpError):
    """An iteration did not converge; ``result`` is the unconverged record, with its statistics."""

    def __init__(self, message: str, result: Any) -> None:
        super().__init__(message)
        self.result = result


class TaskError(HbnlpError):
    """An error ended a trace, a sweep or a search; ``result`` keeps all computed before, the cause is the error."""

    def __init__(self, task: str, result: Any, error: Exception) -> None:
        super().__init__(f"{task} failed; the attribute 'result' of this error keeps all computed before: {error}")
        self.result = result

    def __getattr__(self, name: str) -> Any:
        raise renamed_name("TaskError", name, {"branch": "result"})


class NonFiniteError(HbnlpError):
    """A user's force, forcing or output gave a value or derivative that is not finite."""


class CallbackError(HbnlpError):
    """A user's ``casadi.Callback`` raised an error; its traceback is among what CasADi writes to the standard error."""


class SamplingError(HbnlpError, ValueError):
    """A force would take more samples a period than a smooth one needs, or a forcing or motion is not smooth enough."""


class CornerError(SamplingError):
    """A force has a step or a corner on the motion, or is nearly as steep: no number of samples is enough."""


class SaveError(HbnlpError, OSError):
    """A file could not be written; nothing in memory was lost and no older file was touched."""


class LoadError(HbnlpError, OSError, ValueError):
    """A file is damaged, cut off, of another kind or version, or does not hold what a record of its kind has."""


_IN_CALLBACK = re.compile(r'calling "eval" for object (?P<name>\w+):\s*(?:\S+:\d+: )?(?P<said>.*)', re.DOTALL)


def in_users_words(error: Exception) -> Exception:
    """Return an error of CasADi about a user's ``casadi.Callback`` as what that raised; any other as it is."""
    told = _IN_CALLBACK.search(str(error)) if type(error) is RuntimeError else None
    if told is None:
        return error
    said = " ".join(told["said"].split()) or "without words"
    raised = CallbackError(f"the casadi.Callback {told['name']!r}, which the system calls, raised an error: {said}")
    raised.__cause__ = error
    return raised


def restored(kind: type[HbnlpError], arguments: tuple[Any, ...], state: dict[str, Any]) -> HbnlpError:
    """Return an error from another process without its constructor, whose arguments are not those of the message."""
    error = kind.__new__(kind, *arguments)
    error.__dict__.update(state)
    return error


class OutsideBandWarning(UserWarning):
    """A reduced-order model is evaluated at frequencies outside the band for which its error is known."""


class ValidityWarning(UserWarning):
    """Motions of a wing are beyond what its models allow, or an angle looks like degrees."""


class AliasingWarning(UserWarning):
    """Harmonics of an output are less exact than the tolerance, as it is singular at this motion."""


class LinearInstabilityWarning(UserWarning):
    """The linear part of a system is unstable about rest."""
