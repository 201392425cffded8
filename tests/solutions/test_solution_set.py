"""What a search leaves behind: a sequence of solutions, one file, and a search that goes on as if it had not ended."""

import dataclasses

import casadi as ca
import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.core.callbacks import Autosave, StopTracing
from hbnlp.core.errors import LoadError, SaveError, TaskError
from hbnlp.solutions import search
from hbnlp.solutions.search import Search, find_all
from hbnlp.solutions.solution_set import SolutionSet
from hbnlp.systems import chain, duffing
from hbnlp.systems.system import System

AT = {"omega": 1.2}


def problem(n_harmonics=3):
    return HarmonicBalance(duffing(), n_harmonics)


@pytest.fixture(scope="module")
def whole():
    return find_all(problem(), at=AT)


def check_same(one, other):
    """The same solutions to the last bit, found in the same order, and the generator in the same place."""
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.coefficients, b.coefficients)
        np.testing.assert_array_equal(a.amplitudes, b.amplitudes)
        assert (a.parameters, a.statistics) == (b.parameters, b.statistics)
    assert one.state == other.state


def ending_at(start, error):
    def end(progress):
        if progress.value == start and not progress.done:
            raise error

    return end


def test_a_set_is_a_sequence_that_says_what_was_searched(whole):
    small, *_, large = whole
    assert whole[0] is small
    assert whole[-1] is large
    assert whole[1:] == tuple(whole)[1:]
    assert small in whole
    assert (whole.n_tried, whole.n_starts, whole.complete) == (40, 40, True)
    assert whole.parameters["omega"] == 1.2
    first = ", ".join(f"{abs(solution.harmonics('x')[1]):.6g}" for solution in whole)
    assert repr(whole).splitlines() == [
        "SolutionSet of 'Duffing oscillator': 3 solutions",
        "  at damping_ratio=0.025, cubic=0.1, force=0.18, omega=1.2",
        f"  first harmonics of x: {first}",
        "  all 40 random starts made",
    ]


def test_a_set_is_the_same_after_saving_and_loading(whole, tmp_path):
    whole.save(tmp_path / "found.npz")
    for own in (None, problem()):
        loaded = SolutionSet.load(tmp_path / "found.npz", problem=own)
        check_same(loaded, whole)
        assert repr(loaded) == repr(whole)
    assert loaded[0](loaded.problem.amplitude_squared("x")) == pytest.approx(abs(whole[0].harmonics("x")[1]) ** 2)
    with pytest.raises(SaveError, match="could not write"):
        whole.save(tmp_path / "missing" / "found.npz")


def test_nothing_found_can_be_kept_as_well(tmp_path):
    """x'' + x' + 1 = cos tau drifts away, from wherever it starts."""
    drifting = System(1.0, 0.0, 0.0, forcing=lambda tau, p: [ca.cos(tau) - 1.0])
    found = find_all(HarmonicBalance(drifting, 1), at=AT, method=Search(n_starts=2))
    assert (len(found), found.complete) == (0, True)
    found.save(tmp_path / "found.npz")
    check_same(SolutionSet.load(tmp_path / "found.npz"), found)


@pytest.mark.parametrize("start", [0, 1, 7, 40])
@pytest.mark.parametrize("error", [StopTracing(), ZeroDivisionError("a callback of the user's")], ids=["stop", "error"])
def test_a_search_that_goes_on_from_a_file_is_that_without_end_between(whole, tmp_path, start, error):
    path, made = tmp_path / "found.npz", []
    callbacks = [Autosave(path, seconds=1e-9), ending_at(start, error)]
    if isinstance(error, StopTracing):
        find_all(problem(), at=AT, callbacks=callbacks)
    else:
        with pytest.raises(TaskError) as caught:
            find_all(problem(), at=AT, callbacks=callbacks)
        assert caught.value.result.message == (
            f"ZeroDivisionError after {start} of 40 random starts: a callback of the user's"
        )
    kept = SolutionSet.load(path)
    assert (kept.n_tried, kept.complete) == (start, start == 40)
    goes_on = find_all(problem(), at=AT, known=kept, callbacks=[lambda progress: made.append(progress.value)])
    assert made[:-1] == [*range(start + 1, 41)]
    check_same(goes_on, whole)


@pytest.mark.parametrize("call", [1, 3, 5, 8, 30])
def test_what_an_interrupted_start_found_is_kept_and_the_start_made_again(monkeypatch, whole, call):
    calls, newton = [], search.deflated_newton

    def interrupted(*arguments):
        calls.append(1)
        if len(calls) == call:
            raise KeyboardInterrupt
        return newton(*arguments)

    monkeypatch.setattr(search, "deflated_newton", interrupted)
    part = find_all(problem(), at=AT)
    monkeypatch.undo()
    assert not part.complete
    assert len(part) == 3
    twice = find_all(problem(), known=part, method=Search(n_starts=part.n_tried))
    assert len(twice) == 3
    check_same(find_all(problem(), known=twice), whole)


@pytest.mark.parametrize("kind", ["PCG64", "PCG64DXSM", "MT19937", "Philox", "SFC64"])
def test_every_generator_of_numpy_goes_on_where_it_was(tmp_path, kind):
    def generator():
        return np.random.Generator(getattr(np.random, kind)(7))

    one = generator()
    whole = find_all(problem(), at=AT, method=Search(n_starts=6), rng=one)
    find_all(problem(), at=AT, method=Search(n_starts=3), rng=generator()).save(tmp_path / "found.npz")
    kept, other = SolutionSet.load(tmp_path / "found.npz"), generator()
    check_same(find_all(problem(), known=kept, method=Search(n_starts=6)), whole)
    check_same(find_all(problem(), known=kept, method=Search(n_starts=6), rng=other), whole)
    np.testing.assert_array_equal(one.standard_normal(5), other.standard_normal(5))


def test_a_generator_of_another_kind_is_refused(whole):
    with pytest.raises(ValueError, match=r"rng is .*MT19937.*; give a Generator of the kind .*, PCG64"):
        find_all(problem(), known=whole, rng=np.random.Generator(np.random.MT19937(0)))
    state = dataclasses.replace(whole.state, generator={"bit_generator": "Mine"})
    with pytest.raises(ValueError, match=r"rng is None; give a Generator of the kind .*, Mine"):
        find_all(problem(), known=dataclasses.replace(whole, state=state))


def test_more_starts_go_on_with_a_whole_search(whole):
    more = find_all(problem(), known=whole, method=Search(n_starts=43))
    assert (more.n_tried, more.n_starts, more.complete) == (43, 43, True)
    check_same(more, find_all(problem(), at=AT, method=Search(n_starts=43)))
    fewer = find_all(problem(), known=whole, method=Search(n_starts=3))
    assert (fewer.n_tried, fewer.n_starts, fewer.complete) == (40, 40, True)


def test_mirror_images_stay_what_they_are(tmp_path):
    """-x + x^3 + .3 x' = .1 cos tau: what is traced from an image is an image, and not traced again."""
    system = System(
        1.0, 0.3, -1.0, nonlinear_force=lambda q, v, tau, p: [q[0] ** 3], forcing=lambda tau, p: [0.1 * ca.cos(tau)]
    )
    buckled = HarmonicBalance(system, 3)
    whole = find_all(buckled, at={"omega": 1.0}, method=Search(n_starts=8))
    assert any(whole.state.images)
    part = find_all(buckled, at={"omega": 1.0}, callbacks=[ending_at(2, StopTracing())])
    part.save(tmp_path / "found.npz")
    kept = SolutionSet.load(tmp_path / "found.npz")
    check_same(find_all(buckled, known=kept, method=Search(n_starts=8)), whole)


def test_a_set_of_another_point_or_of_other_harmonics_is_where_a_new_search_begins(whole):
    for balance, at in ((problem(), {"omega": 1.19}), (problem(5), AT)):
        found = find_all(balance, at=at, known=whole, method=Search(n_starts=1))
        assert found.n_tried == 1
        assert [s.statistics["start"] for s in found] == ["known"] * 3


def test_a_set_of_another_system_is_refused(whole, tmp_path):
    other = System(
        1.1,
        lambda p: 2.0 * p.damping_ratio,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [p.cubic * q[0] ** 3],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"damping_ratio": 0.025, "cubic": 0.1, "force": 0.18},
    )
    whole.save(tmp_path / "found.npz")
    with pytest.raises(ValueError, match=r"the solution set has the residual .* in this system"):
        SolutionSet.load(tmp_path / "found.npz", problem=HarmonicBalance(other, 3))
    with pytest.raises(ValueError, match=r"the solution set has the residual .* in this system"):
        find_all(HarmonicBalance(other, 3), known=whole)
    with pytest.raises(ValueError, match=r"the solution set has coefficients of shape \(1, 7\)"):
        SolutionSet.load(tmp_path / "found.npz", problem=HarmonicBalance(chain(2), 3))
    with pytest.raises(LoadError, match="holds a solution set, not a solution"):
        type(whole[0]).load(tmp_path / "found.npz")
