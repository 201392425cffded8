"""Arguments of a trace that are refused, each with what is accepted."""

import casadi as ca
import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.tracing import trace
from hbnlp.continuation.arclength import PseudoArclength
from hbnlp.core.callbacks import ProgressBar
from hbnlp.solutions.solving import solve
from hbnlp.stability.result import Floquet
from hbnlp.systems.system import System

BAD_SPANS = {
    "no length": ((1.0, 1.0), r"span is \(1.0, 1.0\); give two different finite values"),
    "reaches zero": ((0.0, 1.0), "give two values above omega = 0, where the period is infinite"),
    "ends at zero": ((1.0, 0.0), "above omega = 0"),
    "crosses zero": ((-1.0, 1.0), "above omega = 0"),
    "nan": ((np.nan, 1.0), "give two different finite values of omega"),
    "infinite": ((0.5, np.inf), "give two different finite values of omega"),
    "three values": ((0.5, 1.0, 2.0), "give two different finite values of omega"),
    "one value": ((0.5,), "give two different finite values of omega"),
}


@pytest.mark.parametrize(("span", "message"), BAD_SPANS.values(), ids=BAD_SPANS)
def test_a_bad_span_is_refused_with_what_is_accepted(problem, span, message):
    with pytest.raises(ValueError, match=message):
        trace(problem, "omega", span)


@pytest.mark.parametrize("span", [None, 1.0, "wide", ("low", "high")])
def test_what_is_no_span_is_refused(problem, span):
    with pytest.raises((ValueError, TypeError), match="span"):
        trace(problem, "omega", span)


def test_unknown_names_and_options_are_refused(problem):
    with pytest.raises(KeyError, match="unknown parameter 'omga'; did you mean 'omega'"):
        trace(problem, "omga", (0.5, 1.6))
    with pytest.raises(KeyError, match="unknown parameter 'forc'; did you mean 'force'"):
        trace(problem, "omega", (0.5, 1.6), at={"forc": 1.0})
    with pytest.raises(TypeError, match="step"):
        trace(problem, "omega", (0.5, 1.6), step=0.1)
    with pytest.raises(ValueError, match=r"direction is 2; give 1 .* or -1"):
        trace(problem, "omega", (0.5, 1.6), direction=2)


def test_a_start_outside_of_the_span_is_refused(problem):
    start = solve(problem, at={"omega": 1.2})
    with pytest.raises(ValueError, match=r"the start has omega = 1.2, outside the span \(2.0, 3.0\)"):
        trace(problem, "omega", (2.0, 3.0), start=start)
    with pytest.raises(ValueError, match=r"the start has omega = 2, outside the span"):
        trace(problem, "omega", (0.5, 1.6), at={"omega": 2.0})


@pytest.mark.parametrize("option", ["stability", "method", "resume", "callbacks"])
def test_options_that_are_no_options_are_refused(problem, option):
    with pytest.raises(TypeError, match=option):
        trace(problem, "omega", (0.5, 1.6), **{option: "yes"})


def test_what_goes_wrong_most_often_is_told_what_to_do(problem):
    with pytest.raises(TypeError, match=r"subject is System .*; give a HarmonicBalance\(system, n_harmonics"):
        trace(problem.system, "omega", (0.5, 1.6))
    with pytest.raises(TypeError, match=r"resume is 'duffing.npz'; give a Branch, .*Branch.load\(path\)"):
        trace(problem, "omega", (0.5, 1.6), resume="duffing.npz")
    with pytest.raises(TypeError, match=r"callbacks is .*ProgressBar.*; give a list of callables"):
        trace(problem, "omega", (0.5, 1.6), callbacks=ProgressBar())


@pytest.mark.parametrize("stability", [Floquet(), None])
def test_a_singular_mass_matrix_is_named(stability):
    system = System(np.diag([1.0, 0.0]), 0.1 * np.eye(2), np.eye(2), forcing=lambda tau, p: [ca.cos(tau), 0.0])
    with pytest.raises(ValueError, match=r"mass matrix is singular \(row 1 is zero\); every degree of freedom needs"):
        trace(HarmonicBalance(system, 1), "omega", (0.5, 0.8), stability=stability)


BAD_STEPS = [
    ({"step": 0.0}, "step is 0.0"),
    ({"step": 0.5}, "step is"),
    ({"min_step": 0.1}, "step is"),
    ({"angle": 0.0}, "angle is 0.0; .* at most 40, in degrees"),
    ({"angle": 90.0}, "angle is 90.0"),
    ({"max_points": 1}, "max_points is 1; give an integer of at least 2"),
    ({"step": np.nan}, "step is nan"),
]


@pytest.mark.parametrize(("options", "message"), BAD_STEPS)
def test_bad_options_of_the_continuation_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        PseudoArclength(**options)
