"""Diagrams: no branch twice, the points where branches meet, all motions at a value, intervals, marches, files."""

from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

import hbnlp
from hbnlp.diagrams.marching import Next

PITCHFORKS = (0.806147645, 0.924215367)
"""Of the Duffing oscillator at force 2: where the branch of broken symmetry begins and ends, also by 25 harmonics."""


@pytest.fixture(scope="module")
def strong():
    system = hbnlp.systems.duffing(damping_ratio=0.05, cubic=1.0, force=2.0)
    return hbnlp.HarmonicBalance(system, tolerance=1e-4)


@pytest.fixture(scope="module")
def diagram(strong):
    return hbnlp.explore(strong, "omega", (0.3, 4.0))


@pytest.fixture(scope="module")
def parametron():
    return hbnlp.System(
        [[1.0]],
        [[0.02]],
        [[1.0]],
        nonlinear_force=lambda q, v, tau, p: [p.pump * ca.cos(tau) * q[0] + q[0] ** 3],
        parameters={"pump": 0.3},
        name="parametron",
    )


def values(diagram, kind):
    return [junction.point.value for junction in diagram.special_points if junction.point.kind is kind]


def test_a_branch_of_broken_symmetry_is_traced_once_and_known_to_have_an_image(diagram):
    assert len(diagram) == 3
    assert diagram.branches[1].end is hbnlp.End.MET
    assert values(diagram, hbnlp.Kind.BRANCH_POINT) == pytest.approx(PITCHFORKS, rel=1e-6)
    assert [junction.branches for junction in diagram.junctions] == [(0, 1), (0, 1)]
    assert diagram.junctions[0].has_images
    assert not diagram.left


def test_a_resonance_that_leaves_the_span_comes_back_as_another_branch(diagram):
    """The resonant motion turns at omega = 4.1, beyond the span; the quiet one is there from a fold at 1.93 on."""
    assert [origin.value for origin in diagram.origins] == [None, None, 4.0]
    (fold,) = diagram.branches[2].folds
    longer = hbnlp.trace(diagram.branches[0].solution(-1), "omega", (0.3, 5.0), stability=None)
    assert fold.value == pytest.approx(longer.folds[-1].value, abs=1e-4)
    assert sorted(motion.stable for motion in diagram.at(3.0)) == [False, True, True]


@pytest.mark.parametrize("omega", [0.55, 0.7, 0.9, 1.5, 2.5, 3.5])
def test_no_motion_that_a_search_finds_is_missed(strong, diagram, omega):
    found = hbnlp.find_all(strong.with_harmonics(13), at={"omega": omega}, method=hbnlp.Search(n_starts=20))
    motions = diagram.at(omega)
    assert len(found)
    for solution in found:
        assert any(hbnlp.relation(solution, motion.solution, tol=1e-3) is not None for motion in motions)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_a_motion_between_the_point_where_a_branch_begins_and_its_first_one_is_there(diagram, share):
    begins, first = diagram.junctions[0].point.value, diagram.branches[1].parameter[0]
    symmetric, broken = diagram.at(begins + share * (first - begins))
    assert (symmetric.branch, broken.branch, broken.stable, broken.n_images) == (0, 1, True, 1)
    # beside a pitchfork what breaks the symmetry grows as the root of the distance
    mean = [abs(motion.harmonics("x")[0]) for motion in (broken.solution, diagram.branches[1].solution(0))]
    assert mean[0] == pytest.approx(mean[1] * share**0.5, rel=0.02)


def test_stability_of_the_motions_is_that_of_their_multipliers(diagram):
    by_branch = {motion.branch: motion for motion in diagram.at(0.9)}
    assert not by_branch[0].stable
    assert by_branch[1].stable
    assert by_branch[1].n_images == 1


def test_the_interval_of_two_stable_motions_lies_between_the_folds(diagram):
    interval, above = diagram.intervals()
    *folds, quiet = sorted(values(diagram, hbnlp.Kind.FOLD))
    assert [above.low, above.high] == pytest.approx([quiet, 4.0])
    assert (above.at_low.kind, above.at_high) == (hbnlp.Kind.FOLD, None)
    assert [interval.low, interval.high] == pytest.approx(folds)
    assert {interval.at_low.kind, interval.at_high.kind} == {hbnlp.Kind.FOLD}


def test_marches_fall_at_the_folds_and_go_on_through_soft_bifurcations(diagram):
    low, high, _quiet = sorted(values(diagram, hbnlp.Kind.FOLD))
    up, down = diagram.march("up"), diagram.march("down")
    assert [leg.next for leg in up.legs] == [Next.FALL, Next.SOFT, Next.SOFT, Next.END]
    assert [leg.leaves for leg in up.falls] == pytest.approx([high])
    assert [leg.leaves for leg in down.falls] == pytest.approx([low])
    assert down.legs[-1].leaves == pytest.approx(0.3)
    assert [leg.enters for leg in up.legs[1:]] == pytest.approx([leg.leaves for leg in up.legs[:-1]])


def test_without_integration_a_march_falls_where_one_motion_alone_is_stable(diagram):
    assert diagram.march("up", integrated=False).legs[0].next is Next.FALL


def test_a_march_goes_along_modulated_motions_from_one_neimark_sacker_point_to_the_other():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.tuned_absorber(force=0.4), 7)
    diagram = hbnlp.explore(problem, "omega", (0.5, 3.0), depth=0)
    low, high = sorted(values(diagram, hbnlp.Kind.NEIMARK_SACKER))
    for integrated in (True, False):
        first, second = diagram.march("down", integrated=integrated).legs
        assert (first.next, first.leaves, second.enters) == (Next.MODULATED, high, low)
        assert first.falls_at is None
        assert second.falls_at == second.leaves


def test_a_march_begins_on_the_branch_that_is_named(diagram):
    begin = 0.5 * sum(PITCHFORKS)
    assert diagram.march("up", begin=begin, branch=1, integrated=False).legs[0].stretch.branch == 1
    with pytest.raises(ValueError, match=r"branch is 3"):
        diagram.march("up", branch=3)


def test_a_chain_is_explored_whole_or_up_to_a_budget_and_gone_on_with():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.chain(3), tolerance=1e-3)
    whole = hbnlp.explore(problem, "omega", (2.5, 0.2), stability=None)
    part = hbnlp.explore(problem, "omega", (2.5, 0.2), stability=None, max_points=len(whole.branches[0]) + 1)
    assert len(part) < len(whole)
    assert part.left
    again = hbnlp.explore(problem, "omega", (2.5, 0.2), stability=None, resume=part)
    for a, b in zip(whole.branches, again.branches, strict=True):
        assert np.array_equal(a.coefficients, b.coefficients)
    assert not again.left


def test_a_diagram_of_something_else_is_not_gone_on_with():
    system, span = hbnlp.systems.duffing(), (0.5, 1.6)
    problem = hbnlp.HarmonicBalance(system, 3)
    diagram = hbnlp.explore(problem, "omega", span, depth=0)
    for said, change in (
        ("parameter 'force' is 0.05 here but 0.18", {"at": {"force": 0.05}}),
        (r"resume is 'omega over \(0.5, 1.6\)'; give a diagram in omega over \(0.5, 1.7\)", {"span": (0.5, 1.7)}),
        ("shape", {"problem": hbnlp.HarmonicBalance(system, 7)}),
        ("made with multipliers", {"stability": None}),
    ):
        given = {"problem": problem, "name": "omega", "span": span, "depth": 0, **change}
        with pytest.raises(ValueError, match=said):
            hbnlp.explore(**given, resume=diagram)
    again = hbnlp.explore(problem, "omega", span, depth=0, resume=diagram)
    np.testing.assert_array_equal(again.branches[0].coefficients, diagram.branches[0].coefficients)


def test_a_start_of_another_problem_is_solved_for_in_this_one():
    system = hbnlp.systems.duffing()
    problem, finer = (hbnlp.HarmonicBalance(system, n) for n in (3, 7))
    diagram = hbnlp.explore(problem, "omega", (0.5, 1.6), depth=0, start=hbnlp.solve(finer, at={"omega": 0.9}))
    assert {branch.coefficients.shape[2] for branch in diagram.branches} == {7}
    other = hbnlp.solve(hbnlp.HarmonicBalance(hbnlp.systems.duffing(), 3), at={"omega": 0.9})
    assert hbnlp.explore(problem, "omega", (0.5, 1.6), depth=0, start=other).branches[0].problem.system is system


def test_cold_starts_are_made_at_both_ends_beside_a_start_that_is_given():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(), 3)
    upper = max(hbnlp.trace(problem, "omega", (0.6, 1.6)).at(1.2), key=lambda each: abs(each.harmonics("x")[1]))
    cold = hbnlp.explore(problem, "omega", (1.2, 0.6))
    given = hbnlp.explore(problem, "omega", (1.2, 0.6), start=upper)
    assert len(cold) == len(given) == 2
    for diagram in (cold, given):
        assert len(diagram.at(1.2)) == 3


def test_no_branch_of_a_chain_is_traced_twice():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.chain(3), tolerance=1e-3)
    branches = hbnlp.explore(problem, "omega", (2.5, 0.2), stability=None).branches
    assert len(branches) == 3
    for i, branch in enumerate(branches):
        middle = branch.solution(len(branch) // 2)
        for other in (each for j, each in enumerate(branches) if j != i):
            low, high = other.parameter.min(), other.parameter.max()
            there = other.at(middle.parameters["omega"]) if low <= middle.parameters["omega"] <= high else ()
            assert all(hbnlp.relation(motion, middle, tol=1e-4) is None for motion in there)


@pytest.mark.parametrize("kind", [ThreadPoolExecutor, ProcessPoolExecutor])
def test_it_is_the_same_with_an_executor(strong, diagram, kind):
    with kind(2) as executor:
        other = hbnlp.explore(strong, "omega", (0.3, 4.0), executor=executor)
    assert other.origins == diagram.origins
    for a, b in zip(diagram.branches, other.branches, strict=True):
        assert np.allclose(a.coefficients, b.coefficients, rtol=0.0, atol=1e-9)


def test_an_isola_is_found_by_a_search_at_a_value():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.tuned_absorber(), 5)
    diagram = hbnlp.explore(problem, "omega", (0.5, 3.0), stability=None, search_at=[1.8])
    assert [branch.end for branch in diagram.branches] == [hbnlp.End.SPAN_END, hbnlp.End.CLOSED]
    assert diagram.origins[1].value == 1.8
    assert sorted(fold.value for fold in diagram.branches[1].folds) == pytest.approx(
        [1.5658235396, 2.3185469325], abs=1e-8
    )


def test_an_isola_through_a_known_motion_is_traced_once():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.tuned_absorber(), 5)
    isola = hbnlp.explore(problem, "omega", (0.5, 3.0), stability=None, search_at=[1.8]).branches[1]
    motions = [isola.solution(0), isola.solution(len(isola) // 2)]
    diagram = hbnlp.explore(problem, "omega", (0.5, 3.0), stability=None, known=motions)
    assert [branch.end for branch in diagram.branches] == [hbnlp.End.SPAN_END, hbnlp.End.CLOSED]
    assert diagram.origins[1].value == motions[0].parameters["omega"]
    assert diagram.branches[1].parameter.max() == pytest.approx(isola.parameter.max(), rel=1e-3)
    with pytest.raises(ValueError, match=r"known is .* within the span"):
        hbnlp.explore(problem, "omega", (0.5, 1.0), stability=None, known=motions)


def test_a_branch_from_the_end_of_the_span_ends_where_it_turns_into_its_own_image(strong, diagram):
    (motion,) = diagram.branches[1].at(0.86)
    other = hbnlp.explore(strong, "omega", (0.3, 0.86), depth=0, known=[motion])
    assert len(other) == 2
    branch = other.branches[1]
    assert (branch.parameter[0], branch.end) == (0.86, hbnlp.End.MET)
    assert branch.special_points[-1].value == pytest.approx(PITCHFORKS[0], rel=1e-6)
    assert other.junctions[0].branches == (0, 1)
    (stretch,) = (each for each in other.stretches() if each.branch == 1)
    assert (stretch.low, stretch.high) == pytest.approx((PITCHFORKS[0], 0.86))
    assert all(interval.high < PITCHFORKS[0] for interval in other.intervals())  # its images are no other motions


def test_what_crosses_unstable_parts_is_passed_over_where_only_what_is_beside_stable_motions_is_asked_for():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.chain(5), 5)
    diagram = hbnlp.explore(problem, "omega", (2.5, 0.2), beside_stable=True, max_points=2)
    stable = diagram.branches[0].stable
    beside = [junction for junction in diagram.junctions if stable[junction.point.index :][:2].any()]
    assert 0 < len(beside) < len(diagram.junctions)
    assert len(diagram.left) == len(beside)
    with pytest.raises(ValueError, match=r"beside_stable needs stability"):
        hbnlp.explore(problem, "omega", (2.5, 0.2), stability=None, beside_stable=True)


def test_motions_that_begin_at_rest(parametron):
    diagram = hbnlp.explore(hbnlp.HarmonicBalance(parametron, tolerance=1e-4), "omega", (0.4, 3.0))
    assert sorted(branch.periods for branch in diagram.branches) == [1, 1, 2, 2]
    # unstable tongues of x'' + .02 x' + (1 + .3 cos(omega t)) x = 0 begin and end at the four junctions
    assert len(diagram.junctions) == 4
    assert [len(junction.branches) for junction in diagram.junctions] == [2] * 4
    up = diagram.march("up")
    assert [leg.next for leg in up.legs] == [Next.SOFT, Next.FALL, Next.SOFT, Next.END]
    down = diagram.march("down")
    assert [leg.next for leg in down.legs] == [Next.FALL, Next.SOFT, Next.FALL, Next.SOFT, Next.END]
    # from rest, at the upper end of its tongue, to the motion that begins at the lower end
    lower, upper = (junction.point.value for junction in diagram.junctions[:2])
    assert [leg.leaves for leg in down.legs[2:4]] == pytest.approx([upper, lower])
    assert down.legs[3].stretch.branch == 1


def test_a_diagram_comes_back_from_its_file(tmp_path, strong, diagram):
    diagram.save(tmp_path / "diagram.npz")
    loaded = hbnlp.Diagram.load(tmp_path / "diagram.npz", problem=strong)
    assert repr(loaded) == repr(diagram)
    crossing = next(each for each in loaded.special_points if len(each.branches) > 1)
    assert repr(crossing).startswith("branch point at 0.80")
    assert repr(crossing).endswith("of branches 0, 1, the last with a mirror image")
    assert loaded.origins == diagram.origins
    assert [junction.branches for junction in loaded.junctions] == [junction.branches for junction in diagram.junctions]
    again = hbnlp.explore(strong, "omega", (0.3, 4.0), resume=loaded)
    assert [len(branch) for branch in again.branches] == [len(branch) for branch in diagram.branches]
    with pytest.raises(ValueError, match=r"displacement|shape|parameters"):
        hbnlp.Diagram.load(
            tmp_path / "diagram.npz",
            problem=hbnlp.HarmonicBalance(hbnlp.systems.tuned_absorber(), tolerance=1e-4),
        )


def test_a_callback_that_stops_it_keeps_what_there_is(strong):
    def stop(progress):
        if progress.counts["points"] >= 160:
            raise hbnlp.StopTracing

    diagram = hbnlp.explore(strong, "omega", (0.3, 4.0), callbacks=[stop])
    assert len(diagram) == 2
    assert diagram.branches[1].end is hbnlp.End.INTERRUPTED
    again = hbnlp.explore(strong, "omega", (0.3, 4.0), resume=diagram)
    assert again.branches[1].end is hbnlp.End.MET


def test_without_stability_intervals_and_marches_say_what_they_need(strong):
    diagram = hbnlp.explore(strong, "omega", (0.3, 0.6), stability=None, depth=0)
    with pytest.raises(ValueError, match="stability=Floquet"):
        diagram.intervals()
    with pytest.raises(ValueError, match="stability=Floquet"):
        diagram.march("up")
