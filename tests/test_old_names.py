"""Old names are errors that say the new one, and all of them are in the changelog's table."""

import importlib
import re
from pathlib import Path

import numpy as np
import pytest

import hbnlp
import hbnlp.dns
import hbnlp.plot
from hbnlp.core.renamed import renamed_arguments, renamed_name

CHANGELOG = (Path(__file__).parents[1] / "CHANGELOG.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def branch():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(), n_harmonics=3)
    return hbnlp.trace(problem, "omega", (1.0, 1.4), stability=None)


def progress():
    return hbnlp.Progress(task="", name="", value=0.0, fraction=0.0, counts={}, done=False, result=list)


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
        "the start in the problem's place: one from switch_branch leads away from its origin",
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
    "fold_curve(first_span=, second_span=)": (
        lambda b: hbnlp.follow(b.folds[0], "force", second_span=(0.1, 1.0)),
        TypeError,
        "'second_span' any more: it is 'span' now",
    ),
    "trace(problem=)": (
        lambda b: hbnlp.trace(problem=b.problem, name="omega", span=(1.0, 1.4)),
        TypeError,
        "'subject'",
    ),
    "switch_branch(special=)": (lambda b: hbnlp.switch_branch(special=b.folds[0]), TypeError, "it is 'point' now"),
    "branch.values(index=)": (lambda b: b.values(index=3), TypeError, r"^values\(\) .* solution\(index\).parameters"),
    "problem.output_function": (lambda b: b.problem.output_function, AttributeError, r"problem.output\(name\)"),
    "hbnlp.TraceError": (lambda b: hbnlp.TraceError, AttributeError, "hbnlp.TaskError"),
    "error.branch": (lambda b: hbnlp.TaskError("tracing", b, ValueError("x")).branch, AttributeError, "'result' now"),
    "hbnlp.stability.monodromy": (lambda b: hbnlp.stability.monodromy, AttributeError, "floquet.solution..monodromy"),
    "progress.n_points": (lambda b: progress().n_points, AttributeError, r"progress.counts\['points'\]"),
    "progress.n_folds": (lambda b: progress().n_folds, AttributeError, r"progress.counts\['folds'\]"),
    "progress.branch()": (lambda b: progress().branch(), AttributeError, r"progress.result\(\)"),
    "integrate(progress=)": (lambda b: hbnlp.integrate(b.problem.system, progress=print), TypeError, r"callbacks=\["),
    "hbnlp.resolve_harmonics": (
        lambda b: hbnlp.resolve_harmonics,
        AttributeError,
        r"write hbnlp.trace\(hbnlp.HarmonicBalance\(system, tolerance=1e-4\), name, span\)",
    ),
    "hbnlp.ResolvedBranch": (lambda b: hbnlp.ResolvedBranch, AttributeError, "write hbnlp.Branch, which has n_harmon"),
    "hbnlp.plot.plot_resolved": (lambda b: hbnlp.plot.plot_resolved, AttributeError, "color='n_harmonics'"),
    "dns.NonlinearTension": (lambda b: hbnlp.dns.NonlinearTension, AttributeError, "hbnlp.NonlinearMembrane"),
    "dns.LinearTension": (lambda b: hbnlp.dns.LinearTension, AttributeError, "hbnlp.LinearMembrane"),
    "dns.ForceLaw": (lambda b: hbnlp.dns.ForceLaw, AttributeError, "hbnlp.dns.Structure"),
    "dns.Restoring": (lambda b: hbnlp.dns.Restoring, AttributeError, "hbnlp.dns.Structure"),
    "hbnlp.dns.plot": (lambda b: hbnlp.dns.plot, AttributeError, "hbnlp.plot.animate"),
    "hbnlp.membrane": (lambda b: hbnlp.membrane, AttributeError, "from hbnlp import"),
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


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        (
            "from hbnlp import load_branch",
            r"hbnlp has no 'load_branch' any more: write hbnlp.Branch.load\(path, problem=",
        ),
        ("from hbnlp import fold_curve", r"write hbnlp.follow\(fold, 'force', span="),
        ("from hbnlp.stability import monodromy", "write hbnlp.floquet"),
        ("from hbnlp import resolve_harmonics", r"HarmonicBalance\(system, tolerance=1e-4\)"),
        ("from hbnlp import ResolvedBranch", "write hbnlp.Branch, which"),
        ("from hbnlp.plot import plot_resolved", "color='n_harmonics'"),
        ("from hbnlp.dns import LinearTension", "write hbnlp.dns.Membrane"),
        ("import hbnlp.dns.plot", "write hbnlp.plot.animate"),
        ("from hbnlp.solve import Ipopt", "hbnlp.solve is no module any more: write 'from hbnlp import ...'"),
        ("import hbnlp.membrane", "hbnlp.membrane is no module any more"),
    ],
)
def test_an_import_of_an_old_name_says_the_new_one(statement, message):
    with pytest.raises(ImportError, match=message):
        exec(statement)  # noqa: S102


def test_what_never_was_there_is_found_missing_as_ever():
    with pytest.raises(ModuleNotFoundError, match=r"No module named 'hbnlp.nowhere'"):
        importlib.import_module("hbnlp.nowhere")
    assert not hasattr(hbnlp, "load_branch")


def test_values_of_parameters_alone_are_told_to_go_into_at(branch):
    with pytest.raises(TypeError, match=r"values of parameters are given with at=\{'omega': 1.0\}"):
        hbnlp.solve(branch.problem, omega=1.0)
    with pytest.raises(TypeError, match=r"no argument 'near'; it takes problem, at, start, method, throw$"):
        hbnlp.solve(branch.problem, near=branch.solution(0))


def test_a_start_of_another_system_is_said_to_be_one(branch):
    other = hbnlp.HarmonicBalance(hbnlp.systems.tuned_absorber(), n_harmonics=3)
    start = branch.solution(0)
    with pytest.raises(
        ValueError,
        match=r"1 displacement\(s\), the system '.*tuned absorber' has 2: it is of another system",
    ):
        hbnlp.solve(other, at={"omega": 1.0}, start=start)
    with pytest.raises(ValueError, match=r"1 displacement\(s\).*another system"):
        hbnlp.trace(other, "omega", (0.5, 1.5), start=start)
    with pytest.raises(
        ValueError, match=r"start is a solution of another system.*\['damping_ratio', 'cubic'\] are unknown"
    ):
        hbnlp.integrate(other.system, at={"omega": 1.0}, start=start)


@pytest.mark.parametrize("old", OLD_CALLS)
def test_the_changelog_has_every_old_name(old):
    table = re.findall(r"^\s*\| `([^`]+)`", CHANGELOG, flags=re.MULTILINE)
    assert old in table


def test_values_of_any_parameter_along_a_branch(branch):
    np.testing.assert_array_equal(branch.values("omega"), branch.parameter)
    np.testing.assert_array_equal(branch.values("force"), np.full(len(branch), 0.18))
    with pytest.raises(KeyError, match="unknown parameter 'forc'; did you mean 'force'"):
        branch.values("forc")
