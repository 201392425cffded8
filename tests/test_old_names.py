"""Old names are errors that say the new one, and all of them are in the changelog's table."""

import re
from pathlib import Path

import numpy as np
import pytest

import hbnlp
from hbnlp.core.renamed import renamed_arguments, renamed_name

CHANGELOG = (Path(__file__).parents[1] / "CHANGELOG.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def branch():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(), n_harmonics=3)
    return hbnlp.trace(problem, "omega", (1.0, 1.4), stability=None)


def test_an_old_argument_names_the_new_one():
    @renamed_arguments(old="new")
    def double(new):
        return 2 * new

    assert double(new=3) == 6
    with pytest.raises(TypeError, match=r"double\(\) has no argument 'old' any more: it is 'new' now"):
        double(old=3)


def test_an_unknown_attribute_is_a_plain_error():
    assert str(renamed_name("thing", "x", {"y": "z"})) == "thing has no attribute 'x'"


OLD_CALLS = {
    "hbnlp.load_branch": (lambda b: hbnlp.load_branch, AttributeError, r"Branch.load\(path, problem="),
    "hbnlp.fold_curve": (lambda b: hbnlp.fold_curve, AttributeError, r"hbnlp.follow\(fold, 'force', span="),
    "solve(guess=)": (lambda b: hbnlp.solve(b.problem, guess=[[0.0]]), TypeError, "it is 'start' now"),
    "integrate(initial=)": (lambda b: hbnlp.integrate(b.problem.system, initial=[0.0, 0.0]), TypeError, "'start' now"),
    "sweep(initial=)": (
        lambda b: hbnlp.sweep(b.problem.system, "omega", [1.0], initial=[0.0, 0.0]),
        TypeError,
        "'start' now",
    ),
    "trace(away_from=)": (
        lambda b: hbnlp.trace(b.problem, "omega", (1.0, 1.4), away_from=b.solution(0)),
        TypeError,
        r"knows where it leads away from, its origin",
    ),
    "switch_branch(problem, point, name)": (
        lambda b: hbnlp.switch_branch(b.problem, b.folds[0], "omega"),
        TypeError,
        r"switch_branch\(point\)",
    ),
    "branch.values(i)": (lambda b: b.values(3), TypeError, r"solution\(3\).parameters"),
    "problem.parameter(name)": (
        lambda b: b.problem.parameter("omega"),
        AttributeError,
        r"write problem.symbol\(name\)",
    ),
    "stability_limits(parameter=)": (
        lambda b: hbnlp.stability_limits(b.problem.system, parameter="cubic", span=(0.0, 1.0)),
        TypeError,
        "'name' now",
    ),
}


@pytest.mark.parametrize(("call", "error", "message"), OLD_CALLS.values(), ids=OLD_CALLS)
def test_an_old_call_says_the_new_one(branch, call, error, message):
    with pytest.raises(error, match=message):
        call(branch)


@pytest.mark.parametrize("old", OLD_CALLS)
def test_the_changelog_has_every_old_name(old):
    table = re.findall(r"^\s*\| `([^`]+)`", CHANGELOG, flags=re.MULTILINE)
    assert old in table


def test_values_of_any_parameter_along_a_branch(branch):
    np.testing.assert_array_equal(branch.values("omega"), branch.parameter)
    np.testing.assert_array_equal(branch.values("force"), np.full(len(branch), 0.18))
    with pytest.raises(KeyError, match="unknown parameter 'forc'; did you mean 'force'"):
        branch.values("forc")
