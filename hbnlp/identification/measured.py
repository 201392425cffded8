"""Identification from measured amplitudes alone: on which part of the branch each lies, and which are wrong, is found.

Rounds of three steps, until nothing changes: the branch is traced with the values so far, each measurement is given to
one of its stable parts (`parts.py`), and the variables are fitted (`fitting.py`). The fits are robust: weights of the
soft l1 loss [1]_, relative to a standard deviation from the median of the residuals, then none for those that are
beyond a threshold; the last fit is one of least squares without these, with the usual covariance [2]_.

References
----------
.. [1] B. Triggs et al., "Bundle adjustment: a modern synthesis", LNCS 1883 (2000) 298-372,
   doi:10.1007/3-540-44480-7_21.
.. [2] P. J. Rousseeuw, A. M. Leroy, *Robust Regression and Outlier Detection*, Wiley (1987), section 1.2,
   doi:10.1002/0471725382.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import ArrayLike

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.core.checks import (
    counted,
    finite_array,
    instance_of,
    interval,
    list_of,
    position,
    real_number,
    refused,
    unknown_name,
    whole_number,
)
from hbnlp.core.interrupts import interrupts_kept
from hbnlp.core.sending import ReadOnlyArrays
from hbnlp.core.types import Array, BoolArray, IntArray
from hbnlp.design.variables import Variables
from hbnlp.identification.fitting import Identified
from hbnlp.identification.measurements import Measurements
from hbnlp.identification.rounds import Task
from hbnlp.identification.starts import best_of
from hbnlp.systems.parameters import OMEGA

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARGIN = 0.5
"""How far the branch is traced beyond the measured frequencies, in parts of their range."""
POOR = 0.2
"""A fit with residuals of this part of the amplitudes explains nothing: units, output or system are others."""
SAME_FIT = 0.01
"""Relative difference of values up to which two starts led to the same fit."""
MANY = 3
"""One wrong measurement in so many are not a few any more."""


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MeasuredFit(ReadOnlyArrays):
    """Variables identified from measured amplitudes, the branch that they give, and the measurements that are wrong.

    Attributes
    ----------
    identified : Identified
        Values, covariance, limits that bind, noise; ``values`` and ``confidence()`` are its.
    measurements : Measurements
    branch : Branch
        As traced with these values.
    part : array (n,), int
        The stable part that each measurement is taken to lie on, counted along the branch.
    wrong : array of int
        Numbers of the measurements that were left out, as no part passes near them.
    at_fold : array of int
        Numbers of those that lie at a fold, where an amplitude does not vary linearly with the variables within its
        error: they say that the fold does not come before them, but not how accurate the values are.
    output, harmonic
        What was measured.
    weights : array (n,)
        Of the measurements, as given.
    led_to : tuple of (mapping of names to values, or None)
        The values that each start led to, None where the fit failed.
    message : str
        What became of it, and what to do.
    """

    identified: Identified
    measurements: Measurements
    branch: Branch = field(repr=False)
    part: IntArray
    wrong: IntArray
    at_fold: IntArray
    output: str
    harmonic: int
    weights: Array
    led_to: tuple[Mapping[str, float] | None, ...]
    message: str

    @property
    def converged(self) -> bool:
        """Whether the branch of these values gives each measurement the part on which it was fitted."""
        return self.message == "converged"

    @property
    def values(self) -> dict[str, float]:
        """Values of the variables."""
        return self.identified.values

    @property
    def at_limit(self) -> dict[str, float]:
        """Names and limits of the variables that the measurements would have beyond their limits."""
        return self.identified.at_limit

    @property
    def residuals(self) -> Array:
        """Fitted less measured amplitudes, (n,), of the wrong ones as well."""
        return self.identified.residuals

    @property
    def used(self) -> BoolArray:
        """Whether each measurement is among those that the values come from, (n,)."""
        used = np.ones(len(self.measurements), dtype=bool)
        used[self.wrong] = False
        return used

    def confidence(self, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Return the interval of each variable, nan for those at a limit; see `Identified.confidence`."""
        return self.identified.confidence(level)

    def plot(self) -> Figure:
        """Draw measurements on the branch, and their residuals; see `hbnlp.plot.plot_measured_fit`."""
        from hbnlp.plot import plot_measured_fit

        figure: Figure = plot_measured_fit(self)
        return figure

    def __repr__(self) -> str:
        measured = self.measurements
        wrong = "; ".join(measured.named(k) for k in self.wrong[:3]) + ("; ..." if self.wrong.size > 3 else "")
        left_out = f"\n  wrong, left out: {counted(self.wrong.size, 'amplitude')}, {wrong}" if self.wrong.size else ""
        at_fold = "; ".join(measured.named(k) for k in self.at_fold)
        bounds = f"\n  at a fold, which tells its place but no accuracy: {at_fold}" if at_fold else ""
        there = sum(values is not None and self._is_near(values) for values in self.led_to)
        starts = f"\n  the best of {len(self.led_to)} starts; {there} led there" if len(self.led_to) > 1 else ""
        return f"{self.identified!r}{left_out}{bounds}{starts}\n  {self.message}"

    def _is_near(self, values: Mapping[str, float]) -> bool:
        return all(abs(values[name] - value) <= SAME_FIT * abs(value) for name, value in self.values.items())


@interrupts_kept()
def identify(
    problem: HarmonicBalance,
    variables: Variables,
    measurements: Measurements,
    output: str,
    *,
    start: Mapping[str, float] | Sequence[Mapping[str, float]],
    harmonic: int = 1,
    at: Mapping[str, float] | None = None,
    weights: ArrayLike | None = None,
    noise: float | None = None,
    threshold: float = 4.0,
    span: tuple[float, float] | None = None,
    executor: Executor | None = None,
) -> MeasuredFit:
    """Return the variables whose stable responses fit measured amplitudes best, up and down the frequencies.

    On which stable part of the branch a measurement lies is found with the variables. A few that are wrong do no harm,
    and are named. The fit is a local one: begin with values that put the resonance within the measured frequencies.

    Parameters
    ----------
    problem : HarmonicBalance
        With a number of harmonics.
    variables : Variables
        What is to be found, within its limits; not omega.
    measurements : Measurements
    output : str
        Whose amplitude was measured.
    start : mapping of names to values, or sequence of them
        Where the variables begin; of several starts the best fit is returned.
    harmonic : int
        Which one was measured.
    at : mapping of names to values, optional
        Values of other parameters.
    weights : array (n,), optional
        Inverse to the variances of the measurements, but for a factor; equal by default. With errors that are a part of
        each amplitude, ``1 / measurements.amplitude**2``: otherwise good large ones are taken for wrong.
    noise : float, optional
        Standard deviation of a measurement of weight one; by default it is estimated from the residuals.
    threshold : float
        How many standard deviations off a measurement is wrong.
    span : (float, float), optional
        Frequencies over which the branch is traced: enough for both folds. By default half as far again to either side
        as the measurements.
    executor : concurrent.futures.Executor, optional
        Fits from several starts side by side, with the same result.

    Returns
    -------
    MeasuredFit

    Raises
    ------
    ConvergenceError
        If a fit fails, or the branch has no stable part; of several starts, if all fail.
    ValueError, KeyError
        If the measurements do not determine all variables; for a start with other names.
    KeyboardInterrupt
        On Ctrl-C: a fit that is not done is worth nothing.
    """
    instance_of("problem", problem, HarmonicBalance, "a HarmonicBalance(system, n_harmonics=...)")
    instance_of("variables", variables, Variables, "the Variables(...) to be found")
    instance_of("measurements", measurements, Measurements, "Measurements(omega, amplitude), or from a table, from_csv")
    instance_of("executor", executor, Executor | None, "a concurrent.futures.Executor")
    starts = [start] if isinstance(start, Mapping) else start
    list_of("start", starts, Mapping, "a mapping of the variables to values, or a list of such")
    if not starts:
        raise refused(ValueError, "start", start, "one mapping of the variables to values at least")
    for number, each in enumerate(starts):
        called = "start" if isinstance(start, Mapping) else f"start[{number}]"
        _check_start(called, each, variables)
    position("output", output, problem.system.output_names)
    whole_number("harmonic", harmonic, least=1, most=problem.n_harmonics, advice=", which are retained")
    real_number("threshold", threshold, least=2.0, advice=", in standard deviations")
    if noise is not None:
        real_number("noise", noise, above=0.0, advice=", or None to have it estimated")
    if OMEGA in variables.names:
        raise refused(ValueError, "variables", variables.names, "other parameters: omega is what was set")
    low, high = float(measurements.omega.min()), float(measurements.omega.max())
    wide = MARGIN * ((high - low) or low)
    given = interval("span", span, above=0.0) if span is not None else (max(low - wide, 0.3 * low), high + wide)
    problem.values(at, but=(OMEGA, *variables.names))
    others = {**(at or {})}
    for name in others.keys() & {OMEGA, *variables.names}:
        raise refused(ValueError, f"at[{name!r}]", others[name], "values of parameters that are neither found nor set")
    size = len(measurements)
    given_weights = np.ones(size) if weights is None else finite_array("weights", weights, (size,))
    if given_weights.min() <= 0.0:
        raise refused(ValueError, "weights", weights, "weights above zero")
    task = Task(
        problem=problem,
        bounds=dict(zip(variables.names, map(tuple, variables.limits), strict=True)),
        measured=measurements,
        output=output,
        harmonic=harmonic,
        at=others,
        weights=given_weights,
        noise=noise,
        threshold=threshold,
        span=given,
    )
    outcome, led_to = best_of(task, starts, executor)
    wrong = np.flatnonzero(~outcome.fitted.used)
    left, whole = outcome.fitted.found.noise, float(np.sqrt(np.mean(task.even(measurements.amplitude) ** 2)))
    message = "converged"
    if MANY * wrong.size > len(measurements):
        message = (
            f"{wrong.size} of {len(measurements)} amplitudes are on no part of the branch: start nearer, or let more "
            "variables vary"
        )
    elif left > POOR * whole:
        message = (
            f"what the fit leaves, {left:.2g}, is not small beside the amplitudes, {whole:.2g}: "
            "look at the units, the output and the harmonic, or start nearer"
        )
    elif outcome.rounds is None:
        message = "on which parts the measurements lie still changes from round to round: start nearer"
    return MeasuredFit(
        identified=outcome.fitted.found,
        measurements=measurements,
        branch=outcome.branch,
        part=outcome.assignment.labels,
        wrong=wrong,
        at_fold=np.flatnonzero(outcome.at_fold),
        output=output,
        harmonic=harmonic,
        weights=given_weights,
        led_to=led_to,
        message=message,
    )


def _check_start(called: str, start: Mapping[str, float], variables: Variables) -> None:
    for name in {*variables.names} ^ {*start}:
        unknown = f"{called}: {unknown_name('variable', name, variables.names)}"
        raise KeyError(unknown if name in start else f"{called} lacks {name!r}")
    for name, (low, high) in zip(variables.names, variables.limits, strict=True):
        here = f"{called}[{name!r}]"
        if not low <= real_number(here, start[name]) <= high:
            raise refused(ValueError, here, start[name], f"a value within its limits, {low:g} to {high:g}")
