"""Traces of a branch: known folds, ends, other parameters, units, detached branches; saved, resumed and interrupted."""

import errno
import logging

import casadi as ca
import numpy as np
import pytest

from hbnlp.aero import thin_airfoil
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import load_branch
from hbnlp.branches.tracer import Tracer
from hbnlp.branches.tracing import trace
from hbnlp.continuation.arclength import PseudoArclength
from hbnlp.core.callbacks import Autosave, ProgressBar, StopTracing
from hbnlp.core.errors import ConvergenceError, LinearInstabilityWarning, SaveError, TaskError
from hbnlp.core.kinds import End, Kind
from hbnlp.solutions.search import find_all
from hbnlp.solutions.solving import solve
from hbnlp.stability.multipliers import Floquet
from hbnlp.systems import chain, duffing, tuned_absorber
from hbnlp.systems.system import System
from hbnlp.testing import check_branch
from hbnlp.wing.coupling import membrane_wing
from hbnlp.wing.membrane import QuasiLinearMembrane

# x'' + 2 z x' + x + g x^3 = F cos(W t), KNOWN_VALUES, section 1: (z, g, F), and W of the fold that jumps up and of
# the one that jumps down, with 3 harmonics and converged
DUFFING = [
    ((0.025, 0.1, 0.18), (1.115700246882, 1.269600032145), (1.115700251771, 1.2696019555)),
    ((0.05, 1.0, 0.5), (1.438669909563, 2.211937689810), (1.438670145514, 2.211935317020)),
]


def exact_folds(z, g, force):
    """(W, A) of both folds with one harmonic, by falling amplitude.

    p^2 - 2 s p + 4 z^2 (1 + s + p) = 0 and W^2 = 1 + s + p; with a = A^2, s = 3/4 g a and p = c / a^2, where
    c = 2 F^2 / (3 g), the first times a^4 is a quintic in a.
    """
    k, c = 0.75 * g, 2.0 * force**2 / (3.0 * g)
    roots = np.roots([4 * z**2 * k, 4 * z**2, -2 * k * c, 4 * z**2 * c, 0.0, c**2])
    a = np.sort(roots[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0.0)].real)[::-1]
    return [(np.sqrt(1.0 + k * x + c / x**2), np.sqrt(x)) for x in a]


# -- known folds -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", [case[0] for case in DUFFING])
def test_duffing_folds_with_one_harmonic_are_the_closed_form(case):
    z, g, force = case
    branch = trace(HarmonicBalance(duffing(damping_ratio=z, cubic=g, force=force), 1), "omega", (0.5, 3.0))
    check_branch(branch)
    assert branch.end is End.SPAN_END
    assert all(fold.refined for fold in branch.folds)
    found = [(fold.value, abs(fold.solution.harmonics("x")[1])) for fold in branch.folds]
    np.testing.assert_allclose(found, exact_folds(z, g, force), rtol=1e-10)


@pytest.mark.parametrize(("case", "three", "converged"), DUFFING)
def test_duffing_folds_are_those_of_independent_codes(case, three, converged):
    z, g, force = case
    for n_harmonics, (up, down), tol in ((3, three, 1e-11), (11, converged, 1e-10)):
        problem = HarmonicBalance(duffing(damping_ratio=z, cubic=g, force=force), n_harmonics)
        branch = trace(problem, "omega", (0.5, 3.0))
        check_branch(branch)
        np.testing.assert_allclose([fold.value for fold in branch.folds], [down, up], rtol=tol)


def test_duffing_is_unstable_between_its_folds_alone_and_liouville_holds():
    branch = trace(HarmonicBalance(duffing(), 7), "omega", (0.5, 1.6))
    check_branch(branch)
    down, up = branch.folds
    between = np.arange(len(branch))
    np.testing.assert_array_equal(branch.stable, (between <= down.index) | (between > up.index))
    exact = np.exp(-2 * 0.025 * 2 * np.pi / branch.parameter)
    np.testing.assert_allclose(np.prod(branch.multipliers, axis=1), exact, rtol=1e-6)
    for fold in branch.folds:
        assert fold.multiplier == pytest.approx(1.0, abs=1e-5)


def test_a_linear_response_is_traced_without_special_points():
    system = System(1.0, 0.05, 1.0, forcing=lambda tau, p: [ca.cos(tau)])
    branch = trace(HarmonicBalance(system, 2), "omega", (0.2, 5.0))
    check_branch(branch)
    w = branch.parameter
    np.testing.assert_allclose(branch.harmonics("x")[:, 1], 1.0 / (1.0 - w**2 + 0.05j * w), rtol=1e-9)
    assert branch.special_points == ()
    assert branch.stable.all()


# -- the ten-mass chain (KNOWN_VALUES, section 2) ----------------------------------------------------------------------

CHAIN_FOLDS = [
    *(1.037698837, 1.080013925, 0.786500496, 1.076544718, 0.535510968, 1.295849021, 0.966704292, 1.264666301),
    *(0.907068227, 1.291487578, 0.940645927, 1.256394770, 1.068749937, 1.270584141, 0.333995527, 1.965667751),
]
# Where symmetry breaks: odd harmonics x, even null vector v of R(x, w) = 0, R_x v = 0, v.v = 1, solved by Newton's
# method to 1e-12 from every sign change of the determinant that a trace in steps of at most 0.02 sees
CHAIN_BRANCH_POINTS = [
    *(1.1882881437, 1.2190032844, 1.2282369444, 1.2514365808, 1.2514767041, 1.2318400264, 1.2190375984, 1.1895701001),
    *(1.1634203477, 1.1927438329, 1.2330664821, 1.2330960313, 1.1860720605, 1.1622094136, 1.2427567829, 1.2428158102),
    *(1.1153523292, 1.1081341306, 1.1418505113, 1.1578709124, 1.2523613605, 1.2523920465, 1.1597033215, 1.1427017861),
    *(1.1540913752, 1.1830649405, 1.2584668686, 1.2585504626, 1.1849981989, 1.1558220099, 0.4224434917, 0.4314588160),
    *(0.6027812048, 0.6279600310, 0.7654084386, 0.7990030670, 0.9115792506, 0.9524945722, 1.0403148791, 1.0887604971),
    *(1.1482333856, 1.2033833708, 1.2311407839, 1.2812783680, 1.2940563336, 1.3490781875, 1.3495836144, 1.2954663010),
    *(1.2817141065, 1.2319340473, 1.2061868916, 1.1496074561, 1.0929497922, 1.0424160233, 0.9583848399, 0.9147204373),
    *(0.8074861441, 0.7703686117, 0.6419125208, 0.6114309662, 0.4626786464, 0.4408079285, 0.2885521543, 0.2686431694),
]
STEPS = {"default": {}, "short": {"max_step": 0.05}, "long": {"step": 0.1, "max_step": 0.5, "angle": 14.0}}


@pytest.fixture(scope="module")
def chain_problem():
    return HarmonicBalance(chain(10), 7)


@pytest.fixture(scope="module", params=STEPS.values(), ids=STEPS.keys())
def chain_branch(request, chain_problem):
    return trace(chain_problem, "omega", (2.5, 0.2), stability=None, method=PseudoArclength(**request.param))


def test_the_chain_has_its_sixteen_folds_in_order(chain_branch):
    check_branch(chain_branch)
    assert chain_branch.end is End.SPAN_END
    assert all(fold.refined for fold in chain_branch.folds)
    np.testing.assert_allclose([fold.value for fold in chain_branch.folds], CHAIN_FOLDS, rtol=1e-9)


def test_all_but_a_few_pairs_of_the_chains_branch_points_are_found(chain_branch):
    """Two branch points within one step leave the determinant's sign as it was; its dip gives most away."""
    found = np.array([point.value for point in chain_branch.branch_points])
    missed = [value for value in CHAIN_BRANCH_POINTS if np.abs(found - value).min() > 1e-5]
    assert len(missed) <= 4
    assert len(found) % 2 == len(CHAIN_BRANCH_POINTS) % 2


def test_every_branch_point_that_is_said_to_be_refined_is_where_symmetry_breaks(chain_branch):
    refined = np.array([point.value for point in chain_branch.branch_points if point.refined])
    distance = np.abs(np.subtract.outer(refined, CHAIN_BRANCH_POINTS)).min(axis=1)
    assert distance.max() < 1e-7


@pytest.mark.parametrize("step", [0.001, 0.0014, 0.0018, 0.0024, 0.0034, 0.0042, 0.005])
def test_short_steps_pass_through_branch_points(chain_problem, step):
    """At a branch point the corrector has nothing to hold on to: a step must leap over it, not creep up to it."""
    start = solve(chain_problem, at={"omega": 1.3})
    options = PseudoArclength(step=step, max_step=step, max_points=150)
    branch = trace(chain_problem, "omega", (1.3, 1.1), start=start, stability=None, method=options)
    check_branch(branch)
    assert branch.end in (End.MAX_POINTS, End.SPAN_END)


# -- ends of a span ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def problem():
    return HarmonicBalance(duffing(), 5)


@pytest.fixture(scope="module")
def branch(problem):
    return trace(problem, "omega", (0.5, 1.6))


def test_a_trace_begins_and_ends_exactly_on_its_span(branch):
    check_branch(branch)
    assert (branch.parameter[0], branch.parameter[-1]) == (0.5, 1.6)
    assert branch.end is End.SPAN_END
    assert branch.message == "reached the end of the span"


def test_the_way_back_meets_the_same_folds_in_reverse(problem, branch):
    back = trace(problem, "omega", (1.6, 0.5))
    check_branch(back)
    assert (back.parameter[0], back.parameter[-1]) == (1.6, 0.5)
    np.testing.assert_allclose([f.value for f in back.folds], [f.value for f in branch.folds][::-1], rtol=1e-11)


def test_a_span_that_ends_between_the_folds_ends_on_the_first_leg(problem, branch):
    short = trace(problem, "omega", (0.5, 1.2), stability=None)
    check_branch(short)
    assert short.end is End.SPAN_END
    assert short.folds == ()
    upper = branch.parameter[: branch.folds[0].index]
    amplitude = np.interp(1.2, upper, np.abs(branch.harmonics("x")[: upper.size, 1]))
    assert abs(short.harmonics("x")[-1, 1]) == pytest.approx(amplitude, abs=2e-3)


def test_a_branch_that_turns_back_ends_where_it_came_from():
    """The lower leg at W = 1.2 ends at the fold in the force at .4179, which is within the span; .145 is not."""
    problem = HarmonicBalance(duffing(), 3)
    lower = solve(problem, at={"omega": 1.2, "force": 0.3})
    branch = trace(problem, "force", (0.2, 0.43), at={"omega": 1.2}, start=lower)
    check_branch(branch)
    assert branch.end is End.SPAN_START
    assert branch.parameter[-1] == 0.2
    assert len(branch.folds) == 1


def test_both_directions_from_an_interior_start_cover_the_branch(problem, branch):
    start = solve(problem, at={"omega": 1.2}, guess=[[0.0, -2.2, 0.5]])
    ahead, back = (trace(problem, "omega", (0.5, 1.6), start=start, direction=d) for d in (1, -1))
    for half in (ahead, back):
        check_branch(half)
        np.testing.assert_allclose(half.coefficients[0], start.coefficients, atol=1e-10)
    assert {ahead.end, back.end} == {End.SPAN_END, End.SPAN_START}
    assert {ahead.parameter[-1], back.parameter[-1]} == {0.5, 1.6}
    folds = [f.value for half in (ahead, back) for f in half.folds]
    np.testing.assert_allclose(sorted(folds), sorted(f.value for f in branch.folds), rtol=1e-11)


def test_a_value_of_the_parameter_in_at_is_where_the_trace_begins(problem, branch):
    inside = trace(problem, "omega", (0.5, 1.6), at={"omega": 1.0}, stability=None)
    check_branch(inside)
    assert inside.parameter[0] == 1.0
    np.testing.assert_allclose([f.value for f in inside.folds], [f.value for f in branch.folds], rtol=1e-11)


# -- other parameters and units ----------------------------------------------------------------------------------------


def test_an_amplitude_is_continued_from_rest():
    """F^2 = A^2 ((1 - W^2 + 3/4 g A^2)^2 + (2 z W)^2) is stationary in A^2 at both folds of the force, exactly."""
    z, g, omega = 0.025, 0.1, 1.2
    problem = HarmonicBalance(duffing(), 1)
    branch = trace(problem, "force", (0.0, 0.5), at={"omega": omega})
    check_branch(branch)
    np.testing.assert_array_equal(branch.coefficients[0], 0.0)
    assert branch.end is End.SPAN_END
    detuning, drag = 1 - omega**2, (2 * z * omega) ** 2
    k = 0.75 * g
    squares = np.sort(np.roots([3 * k**2, 4 * k * detuning, detuning**2 + drag]))
    exact = np.sqrt(squares * ((detuning + k * squares) ** 2 + drag))
    np.testing.assert_allclose([fold.value for fold in branch.folds], exact, rtol=1e-10)


def test_an_amplitude_is_continued_down_to_rest_and_through_it():
    problem = HarmonicBalance(duffing(), 3)
    up = trace(problem, "force", (0.0, 0.5), at={"omega": 1.2}, stability=None)
    down = trace(problem, "force", (0.5, 0.0), at={"omega": 1.2}, stability=None)
    through = trace(problem, "force", (-0.5, 0.5), at={"omega": 1.2}, stability=None)
    for branch in (down, through):
        check_branch(branch)
        assert branch.end is End.SPAN_END
    assert down.parameter[-1] == 0.0
    np.testing.assert_allclose(down.coefficients[-1], 0.0, atol=1e-12)
    values = [fold.value for fold in up.folds]
    np.testing.assert_allclose([fold.value for fold in down.folds], values[::-1], rtol=1e-11)
    mirrored = [-values[1], -values[0], *values]
    np.testing.assert_allclose([fold.value for fold in through.folds], mirrored, rtol=1e-11)


@pytest.mark.parametrize(
    ("name", "span"), [("cubic", (0.0, 1.0)), ("damping_ratio", (0.3, 0.01)), ("cubic", (-0.1, 1.0))]
)
def test_any_parameter_can_be_continued_in(name, span):
    problem = HarmonicBalance(duffing(), 3)
    branch = trace(problem, name, span, at={"omega": 1.2})
    check_branch(branch)
    assert branch.end is End.SPAN_END
    at = {"omega": 1.2, name: branch.parameter[-1]}
    again = solve(problem, at=at, guess=branch.solution(len(branch) - 1))
    np.testing.assert_allclose(again.coefficients, branch.coefficients[-1], atol=1e-8)


@pytest.mark.parametrize(("length", "time"), [(1e-6, 1.0), (1e6, 1.0), (1.0, 1e-3), (1.0, 1e3), (1e-9, 1e-6)])
def test_other_units_need_no_tuning(length, time):
    system = System(
        1.0,
        0.05 / time,
        1.0 / time**2,
        nonlinear_force=lambda q, v, tau, p: [0.1 / (length * time) ** 2 * q[0] ** 3],
        forcing=lambda tau, p: [0.18 * length / time**2 * ca.cos(tau)],
    )
    branch = trace(HarmonicBalance(system, 3), "omega", (0.5 / time, 1.6 / time))
    check_branch(branch)
    up, down = DUFFING[0][1]
    np.testing.assert_allclose([fold.value * time for fold in branch.folds], [down, up], rtol=1e-10)


def test_a_membrane_wing_is_traced_in_frequency_and_in_pitch_from_rest():
    wing = membrane_wing(QuasiLinearMembrane(prestrain=0.008, n_modes=2), thin_airfoil(2))
    problem = HarmonicBalance(wing, 3)
    up = trace(problem, "pitch_amplitude", (0.0, 0.1), at={"omega": 2.0})
    check_branch(up)
    np.testing.assert_array_equal(up.amplitudes[0, :1], 0.0)
    across = trace(problem, "omega", (0.5, 2.0), at={"pitch_amplitude": 0.1})
    check_branch(across)
    np.testing.assert_allclose(across.coefficients[-1], up.coefficients[-1], atol=1e-9)
    assert across.harmonics("C_L").shape == (len(across), 4)


# -- a detached branch (KNOWN_VALUES, section 3) -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def absorber():
    return HarmonicBalance(tuned_absorber(force=0.15), 5)


# first harmonics [0, cos, sin] of host and absorber on the isola at w = 1.9, from an independent search
ISOLA_START = {1: [[0.0, -1.04, 1.44], [0.0, 0.64, -0.92]], -1: [[0.0, 0.95, 1.54], [0.0, -0.6, -1.0]]}


@pytest.fixture(scope="module", params=[1, -1])
def isola(request, absorber):
    start = solve(absorber, at={"omega": 1.9}, guess=ISOLA_START[1])
    return trace(absorber, "omega", (0.5, 3.0), start=start, direction=request.param)


def test_the_main_branch_of_the_absorber_has_its_four_folds(absorber):
    branch = trace(absorber, "omega", (0.5, 3.0))
    check_branch(branch)
    exact = [1.1112622160, 1.1001859507, 1.3004881667, 1.2472807483]
    np.testing.assert_allclose([fold.value for fold in branch.folds], exact, rtol=1e-10)


def test_an_isola_is_recognised_when_it_closes(isola):
    check_branch(isola)
    assert isola.closed
    assert isola.end is End.CLOSED
    np.testing.assert_allclose(isola.coefficients[-1], isola.coefficients[0], atol=1e-8)
    np.testing.assert_allclose(sorted(f.value for f in isola.folds), [1.5658235396, 2.3185469325], rtol=1e-10)
    assert isola.parameter.min() == pytest.approx(1.5658235396, rel=1e-3)


def test_an_isola_is_the_same_loop_the_other_way_round(isola, absorber):
    start = solve(absorber, at={"omega": 1.9}, guess=ISOLA_START[-1])
    other = trace(absorber, "omega", (0.5, 3.0), start=start, stability=None)
    check_branch(other)
    assert other.closed
    length = [branch.arclength[-1] for branch in (isola, other)]
    assert length[1] == pytest.approx(length[0], rel=1e-2)


def test_an_isola_that_leaves_the_span_ends_on_its_limit(absorber):
    start = solve(absorber, at={"omega": 1.9}, guess=ISOLA_START[1])
    branch = trace(absorber, "omega", (0.5, 2.0), start=start, stability=None)
    check_branch(branch)
    assert branch.end is End.SPAN_END
    assert branch.parameter[-1] == 2.0


# -- driving by hand ---------------------------------------------------------------------------------------------------


def test_the_user_may_drive_the_trace_and_stop_at_will(problem, branch):
    tracer = Tracer(problem, "omega", (0.5, 1.6), stability=Floquet())
    for point in tracer:
        if point.special_points:
            break
    assert tracer.end is None
    partial = tracer.branch()
    check_branch(partial)
    assert partial.end is End.STOPPED
    assert len(partial) == tracer.n_points == branch.folds[0].index + 2
    assert tracer.n_folds == 1
    for _ in tracer:
        pass
    assert tracer.end is End.SPAN_END
    whole = tracer.branch()
    np.testing.assert_array_equal(whole.coefficients, branch.coefficients)


def test_max_points_ends_a_trace_that_can_be_resumed(problem, branch):
    options = PseudoArclength(max_points=20)
    first = trace(problem, "omega", (0.5, 1.6), method=options)
    assert first.end is End.MAX_POINTS
    assert len(first) == 20
    assert "resume it" in first.message
    check_branch(first)
    rest = trace(problem, "omega", (0.5, 1.6), resume=first)
    check_branch(rest)
    assert rest.end is End.SPAN_END
    np.testing.assert_allclose([f.value for f in rest.folds], [f.value for f in branch.folds], rtol=1e-11)


# -- files -------------------------------------------------------------------------------------------------------------


def assert_same(one, other):
    for name in (
        *("parameter", "coefficients", "amplitudes", "multipliers", "stable", "stability_error", "stability_converged"),
        *("arclength", "residual", "iterations", "n_samples"),
    ):
        a, b = getattr(one, name), getattr(other, name)
        assert (a is None) == (b is None), name
        if a is not None:
            np.testing.assert_array_equal(a, b, err_msg=name)
            assert a.dtype == b.dtype, name
    for name in (
        "name",
        "span",
        "end",
        "message",
        "parameter_names",
        "system_name",
        "output_names",
        "periods",
        "refused",
    ):
        assert getattr(one, name) == getattr(other, name), name
    assert dict(one.parameters) == dict(other.parameters)
    assert len(one.special_points) == len(other.special_points)
    for p, q in zip(one.special_points, other.special_points, strict=True):
        assert (p.kind, p.value, p.bracket, p.index, p.refined) == (q.kind, q.value, q.bracket, q.index, q.refined)
        assert p.multiplier == q.multiplier
        assert dict(p.sensitivity) == dict(q.sensitivity)
        np.testing.assert_array_equal(p.solution.coefficients, q.solution.coefficients)
        np.testing.assert_array_equal(p.solution.amplitudes, q.solution.amplitudes)
        assert dict(p.solution.parameters) == dict(q.solution.parameters)
        assert dict(p.solution.statistics) == dict(q.solution.statistics)
        assert (p.null is None) == (q.null is None)
        if p.null is not None:
            np.testing.assert_array_equal(p.null, q.null)


def test_a_branch_is_the_same_after_saving_and_loading(branch, tmp_path):
    branch.save(tmp_path / "branch.npz")
    loaded = load_branch(tmp_path / "branch.npz")
    assert_same(branch, loaded)
    check_branch(loaded)
    assert loaded.problem is None
    assert repr(loaded) == repr(branch)


def test_branch_points_neimark_sacker_and_no_stability_survive_the_file(absorber, tmp_path):
    start = solve(absorber, at={"omega": 1.9}, guess=ISOLA_START[1])
    with_stability = trace(absorber, "omega", (0.5, 3.0), start=start)
    assert {p.kind for p in with_stability.special_points} == {Kind.FOLD, Kind.NEIMARK_SACKER}
    without = trace(HarmonicBalance(chain(3), 3), "omega", (2.5, 0.4), stability=None)
    for branch in (with_stability, without):
        branch.save(tmp_path / "branch.npz")
        assert_same(branch, load_branch(tmp_path / "branch.npz"))


def test_what_is_no_branch_is_refused(branch, tmp_path):
    with pytest.raises(FileNotFoundError):
        load_branch(tmp_path / "nothing.npz")
    (tmp_path / "text.npz").write_text("not an archive")
    with pytest.raises(ValueError, match=r"text\.npz.* is not a readable branch file"):
        load_branch(tmp_path / "text.npz")
    branch.save(tmp_path / "branch.npz")
    whole = (tmp_path / "branch.npz").read_bytes()
    (tmp_path / "half.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"half\.npz.* is not a readable branch file"):
        load_branch(tmp_path / "half.npz")
    thin_airfoil(2).save(tmp_path / "rom.npz")
    with pytest.raises(ValueError, match=r"rom\.npz.* holds a .*, not a branch"):
        load_branch(tmp_path / "rom.npz")


def test_a_full_disk_leaves_the_older_file_and_the_branch_as_they_were(branch, tmp_path, monkeypatch):
    path = tmp_path / "branch.npz"
    path.write_bytes(b"older")

    def full(handle, **_):
        handle.write(b"part")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("hbnlp.core.storage.np.savez_compressed", full)
    with pytest.raises(
        SaveError, match=r"could not write .*branch\.npz.*No space left on device.*save again"
    ) as caught:
        branch.save(path)
    assert caught.value.errno == errno.ENOSPC
    assert [file.name for file in tmp_path.iterdir()] == ["branch.npz"]
    assert path.read_bytes() == b"older"
    monkeypatch.undo()
    branch.save(path)
    assert_same(branch, load_branch(path))


# -- resuming ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 15, 30, 45])
def test_a_trace_resumed_from_a_file_is_that_without_interruption(problem, branch, tmp_path, count):
    """Wherever it stopped: the same folds in the same order, the same stability between them, and the same end."""
    short = trace(problem, "omega", (0.5, 1.6), method=PseudoArclength(max_points=max(count, 2)))
    if count == 1:
        tracer = Tracer(problem, "omega", (0.5, 1.6), stability=Floquet())
        next(iter(tracer))
        short = tracer.branch()
    assert len(short) == count
    short.save(tmp_path / "part.npz")
    resumed = trace(HarmonicBalance(duffing(), 5), "omega", (0.5, 1.6), resume=load_branch(tmp_path / "part.npz"))
    check_branch(resumed)
    assert resumed.end is End.SPAN_END
    np.testing.assert_array_equal(resumed.coefficients[:count], short.coefficients)
    np.testing.assert_allclose([f.value for f in resumed.folds], [f.value for f in branch.folds], rtol=1e-11)
    assert (resumed.parameter[0], resumed.parameter[-1]) == (0.5, 1.6)
    np.testing.assert_array_equal(np.flatnonzero(np.diff(resumed.stable)), [f.index for f in resumed.folds])


@pytest.mark.parametrize("count", [3, 25])
def test_a_resumed_isola_still_closes_where_it_began(absorber, tmp_path, count):
    start = solve(absorber, at={"omega": 1.9}, guess=ISOLA_START[1])
    first = trace(absorber, "omega", (0.5, 3.0), start=start, stability=None, method=PseudoArclength(max_points=count))
    first.save(tmp_path / "part.npz")
    resumed = trace(absorber, "omega", (0.5, 3.0), stability=None, resume=load_branch(tmp_path / "part.npz"))
    check_branch(resumed)
    assert resumed.end is End.CLOSED
    np.testing.assert_allclose(sorted(f.value for f in resumed.folds), [1.5658235396, 2.3185469325], rtol=1e-10)


def test_a_finished_branch_can_be_resumed_into_a_longer_span(problem, branch):
    longer = trace(problem, "omega", (0.5, 2.0), resume=branch)
    check_branch(longer)
    assert longer.end is End.SPAN_END
    assert longer.parameter[-1] == 2.0
    np.testing.assert_array_equal(longer.coefficients[: len(branch)], branch.coefficients)


def test_resuming_keeps_the_parameters_of_the_branch():
    problem = HarmonicBalance(duffing(), 3)
    first = trace(
        problem, "omega", (0.5, 1.6), at={"force": 0.3}, method=PseudoArclength(max_points=10), stability=None
    )
    resumed = trace(problem, "omega", (0.5, 1.6), resume=first, stability=None)
    check_branch(resumed)
    assert resumed.parameters["force"] == 0.3


REFUSED = {
    "another parameter": (lambda: (duffing(), 5, {}, "force", (0.0, 1.0)), "was traced in 'omega', not in 'force'"),
    "other harmonics": (lambda: (duffing(), 7, {}, "omega", (0.5, 1.6)), r"coefficients of shape \(1, 11\)"),
    "another size": (lambda: (tuned_absorber(), 5, {}, "omega", (0.5, 1.6)), r"coefficients of shape \(1, 11\)"),
    "other values": (
        lambda: (duffing(), 5, {"force": 0.2}, "omega", (0.5, 1.6)),
        "parameter 'force' is 0.2 here but 0.18",
    ),
    "other names": (
        lambda: (System(1.0, 0.1, 1.0, parameters={"a": 1.0}), 5, {}, "omega", (0.5, 1.6)),
        r"parameters .*'cubic'.*, the system \('a', 'omega'\)",
    ),
    "a span it is not in": (lambda: (duffing(), 5, {}, "omega", (2.0, 3.0)), "outside the span"),
}


@pytest.mark.parametrize(("make", "message"), REFUSED.values(), ids=REFUSED)
def test_a_branch_of_something_else_is_not_resumed(branch, make, message):
    system, n_harmonics, at, name, span = make()
    with pytest.raises(ValueError, match=message):
        trace(HarmonicBalance(system, n_harmonics), name, span, at=at, resume=branch)


def test_a_branch_of_other_periods_is_not_resumed(branch):
    with pytest.raises(ValueError, match="period"):
        trace(HarmonicBalance(duffing(), 5, periods=2), "omega", (0.5, 1.6), resume=branch)


def test_a_branch_of_another_system_with_the_same_names_is_not_resumed(problem):
    first = trace(problem, "omega", (0.5, 1.6), stability=None, method=PseudoArclength(max_points=10))
    system = System(
        1.1,
        lambda p: 2.0 * p.damping_ratio,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [p.cubic * q[0] ** 3],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"damping_ratio": 0.025, "cubic": 0.1, "force": 0.18},
    )
    with pytest.raises(ValueError, match=r"the last point of the branch has the residual .* in this system"):
        trace(HarmonicBalance(system, 5), "omega", (0.5, 1.6), stability=None, resume=first)


# -- interruptions and errors ------------------------------------------------------------------------------------------


def raising_at(count, error):
    def callback(progress):
        if progress.counts["points"] == count and not progress.done:
            raise error

    return callback


def test_ctrl_c_keeps_all_points_and_the_trace_can_be_resumed(problem, branch, caplog):
    stopped = trace(problem, "omega", (0.5, 1.6), callbacks=[raising_at(30, KeyboardInterrupt())])
    assert stopped.end is End.INTERRUPTED
    assert len(stopped) == 30
    assert "interrupted after 30 points" in caplog.text
    check_branch(stopped)
    np.testing.assert_array_equal(stopped.coefficients, branch.coefficients[:30])
    resumed = trace(problem, "omega", (0.5, 1.6), resume=stopped)
    check_branch(resumed)
    assert resumed.end is End.SPAN_END
    assert len(resumed.folds) == 2


def test_ctrl_c_within_a_step_keeps_all_points(monkeypatch):
    problem = HarmonicBalance(duffing(), 5)
    residual, calls = problem.assembly.residual, []

    def interrupted(*arguments, **options):
        calls.append(1)
        if len(calls) == 100:
            raise KeyboardInterrupt
        return residual(*arguments, **options)

    monkeypatch.setattr(problem.assembly, "residual", interrupted)
    stopped = trace(problem, "omega", (0.5, 1.6))
    assert stopped.end is End.INTERRUPTED
    assert len(stopped) > 5
    check_branch(stopped)


def test_a_callback_may_stop_the_trace(problem):
    stopped = trace(problem, "omega", (0.5, 1.6), callbacks=[raising_at(7, StopTracing())])
    assert stopped.end is End.STOPPED
    assert len(stopped) == 7
    check_branch(stopped)


@pytest.mark.parametrize("error", [RuntimeError("from a callback"), MemoryError(), ZeroDivisionError("oops")], ids=repr)
def test_an_error_on_the_way_carries_the_branch_so_far(problem, error):
    with pytest.raises(TaskError, match="tracing omega failed; the attribute 'result'") as caught:
        trace(problem, "omega", (0.5, 1.6), callbacks=[raising_at(12, error)])
    branch = caught.value.result
    assert caught.value.__cause__ is error
    assert branch.end is End.ERROR
    assert type(error).__name__ in branch.message
    assert len(branch) == 12
    check_branch(branch)


def test_an_error_of_the_force_on_the_way_carries_the_branch_so_far():
    """The force loses its derivative where x reaches 1: no number of samples is enough there."""
    system = System(
        1.0,
        0.1,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [-0.1 * q[0] * ca.sqrt(1.0 - q[0] ** 2)],
        forcing=lambda tau, p: [0.3 * ca.cos(tau)],
    )
    with pytest.raises(TaskError, match=r"tracing omega failed.*not smooth enough") as caught:
        trace(HarmonicBalance(system, 3), "omega", (0.3, 1.6))
    branch = caught.value.result
    assert len(branch) > 5
    check_branch(branch)
    assert np.abs(branch.harmonics("x")[:, 1]).max() > 0.8


def test_a_force_that_ceases_to_be_finite_ends_the_branch_where_it_does(caplog):
    """log(1 - x^2) pushes outward with all its derivatives: the branch comes as near as it can and says so."""
    system = System(
        1.0,
        0.1,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [0.05 * q[0] * ca.log(1.0 - q[0] ** 2)],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"force": 0.1},
    )
    problem = HarmonicBalance(system, 3)
    try:
        branch = trace(problem, "force", (0.01, 2.0), at={"omega": 0.5}, stability=None)
    except TaskError as error:
        branch = error.result
    check_branch(branch)
    assert branch.end in (End.STEP_TOO_SMALL, End.ERROR)
    assert 0.3 < branch.parameter[-1] < 2.0
    assert branch.end is End.ERROR or "the trace ended at force" in caplog.text


def test_a_start_that_does_not_converge_is_an_error_before_the_first_point():
    system = System(1.0, 0.0, 1.0, forcing=lambda tau, p: [ca.cos(tau)])
    with pytest.raises(ConvergenceError, match=r"no solution at omega=1"):
        trace(HarmonicBalance(system, 1), "omega", (1.0, 2.0))


def test_an_unstable_linear_part_is_a_warning_and_tracing_goes_on():
    system = System(
        1.0,
        0.1,
        -1.0,
        nonlinear_force=lambda q, v, tau, p: [q[0] ** 3],
        forcing=lambda tau, p: [0.3 * ca.cos(tau)],
    )
    with pytest.warns(LinearInstabilityWarning, match="linearly unstable about rest: eigenvalue"):
        branch = trace(HarmonicBalance(system, 3), "omega", (0.3, 1.6))
    check_branch(branch)
    assert branch.end is End.SPAN_END


def test_samples_are_doubled_on_the_way_and_the_branch_goes_on_where_it_was():
    """The larger a pendulum's swing, the more harmonics has the sine of it."""
    system = System(
        1.0,
        0.05,
        0.3,
        nonlinear_force=lambda q, v, tau, p: [ca.sin(q[0])],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"force": 0.1},
    )
    branch = trace(HarmonicBalance(system, 2), "force", (0.0, 5.0), at={"omega": 0.4}, stability=None)
    check_branch(branch)
    assert branch.end is End.SPAN_END
    assert branch.n_samples[0] < branch.n_samples[-1] <= 200
    assert np.all(np.diff(branch.n_samples) >= 0)


# -- saving on the way -------------------------------------------------------------------------------------------------


def test_autosave_on_a_path_that_cannot_be_written_is_logged_and_the_trace_goes_on(problem, branch, tmp_path, caplog):
    path = tmp_path / "missing" / "branch.npz"
    with caplog.at_level(logging.WARNING):
        traced = trace(problem, "omega", (0.5, 1.6), callbacks=[Autosave(path, seconds=1e-9)])
    assert_same(traced, branch)
    assert caplog.text.count("autosave failed, tracing omega goes on") >= 2
    assert str(path) in caplog.text


def test_autosave_on_a_full_disk_keeps_the_last_good_file(problem, branch, tmp_path, monkeypatch, caplog):
    path, save = tmp_path / "branch.npz", np.savez_compressed

    def filling(handle, **arrays):
        if arrays["parameter"].size > 20:
            raise OSError(errno.ENOSPC, "No space left on device")
        save(handle, **arrays)

    monkeypatch.setattr("hbnlp.core.storage.np.savez_compressed", filling)
    traced = trace(problem, "omega", (0.5, 1.6), callbacks=[Autosave(path, seconds=1e-9)])
    assert_same(traced, branch)
    assert "No space left on device" in caplog.text
    kept = load_branch(path)
    check_branch(kept)
    assert len(kept) == 20
    monkeypatch.undo()
    resumed = trace(problem, "omega", (0.5, 1.6), resume=kept)
    check_branch(resumed)
    np.testing.assert_allclose([f.value for f in resumed.folds], [f.value for f in branch.folds], rtol=1e-11)


def test_autosave_leaves_a_file_that_resumes_after_an_error(problem, tmp_path):
    path = tmp_path / "branch.npz"
    with pytest.raises(TaskError):
        trace(problem, "omega", (0.5, 1.6), callbacks=[Autosave(path, seconds=1e-9), raising_at(25, RuntimeError())])
    kept = load_branch(path)
    assert len(kept) == 25
    resumed = trace(problem, "omega", (0.5, 1.6), resume=kept)
    check_branch(resumed)
    assert resumed.end is End.SPAN_END


# -- arguments ---------------------------------------------------------------------------------------------------------

BAD_SPANS = {
    "no length": ((1.0, 1.0), r"span = \(1.0, 1.0\) has no length"),
    "reaches zero": ((0.0, 1.0), "reaches omega = 0, where the period is infinite; begin above"),
    "ends at zero": ((1.0, 0.0), "reaches omega = 0"),
    "crosses zero": ((-1.0, 1.0), "reaches omega = 0"),
    "nan": ((np.nan, 1.0), "two finite values of omega are needed"),
    "infinite": ((0.5, np.inf), "two finite values of omega are needed"),
    "three values": ((0.5, 1.0, 2.0), "two finite values of omega are needed"),
    "one value": ((0.5,), "two finite values of omega are needed"),
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
    with pytest.raises(ValueError, match=r"direction = 2; 1 .* or -1 is needed"):
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
    with pytest.raises(TypeError, match=r"problem is System .*; give a HarmonicBalance\(system, n_harmonics"):
        trace(problem.system, "omega", (0.5, 1.6))
    with pytest.raises(TypeError, match=r"resume is 'duffing.npz'; give a Branch, .*hbnlp.load_branch\(path\)"):
        trace(problem, "omega", (0.5, 1.6), resume="duffing.npz")
    with pytest.raises(TypeError, match=r"callbacks is .*ProgressBar.*; give a list of callables"):
        trace(problem, "omega", (0.5, 1.6), callbacks=ProgressBar())


@pytest.mark.parametrize("stability", [Floquet(), None])
def test_a_singular_mass_matrix_is_named(stability):
    system = System(np.diag([1.0, 0.0]), 0.1 * np.eye(2), np.eye(2), forcing=lambda tau, p: [ca.cos(tau), 0.0])
    with pytest.raises(ValueError, match=r"mass matrix is singular \(row 1 is zero\); every degree of freedom needs"):
        trace(HarmonicBalance(system, 1), "omega", (0.5, 0.8), stability=stability)


BAD_STEPS = [
    ({"step": 0.0}, "step = 0.0"),
    ({"step": 0.5}, "0 < min_step <= step <= max_step is needed"),
    ({"min_step": 0.1}, "0 < min_step <= step <= max_step is needed"),
    ({"angle": 0.0}, "angle = 0.0; between 0 and 40 degrees"),
    ({"angle": 90.0}, "angle = 90.0"),
    ({"max_points": 1}, "max_points = 1; at least 2 are needed"),
    ({"step": np.nan}, "step = nan"),
]


@pytest.mark.parametrize(("options", "message"), BAD_STEPS)
def test_bad_options_of_the_continuation_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        PseudoArclength(**options)


def test_the_repr_of_a_branch_is_five_lines_of_facts(branch):
    lines = repr(branch).splitlines()
    assert len(lines) <= 5
    assert "2 folds" in repr(branch)
    assert f"{len(branch)} points, 5 harmonics" in repr(branch)
    assert "reached the end of the span" in repr(branch)


def test_an_unknown_output_of_a_branch_is_refused(branch):
    with pytest.raises(KeyError, match=r"unknown output 'y' \(known: x\)"):
        branch.harmonics("y")


@pytest.mark.parametrize("way", [{"resume": True}, {"start": -1}, {"direction": -1}], ids=str)
def test_no_trace_leaves_its_span(problem, branch, way):
    """At an end of the span, heading out: there is nothing left to do."""
    if "resume" in way:
        resumed = trace(problem, "omega", branch.span, resume=branch)
        assert resumed.end is End.SPAN_END
        np.testing.assert_array_equal(resumed.parameter, branch.parameter)
        return
    options = {"start": branch.solution(-1)} if "start" in way else way
    with pytest.raises(ValueError, match=r"an end of the span .* and the way first taken leads out of it"):
        trace(problem, "omega", branch.span, **options)


def test_a_closed_branch_is_not_gone_round_again():
    problem = HarmonicBalance(tuned_absorber(force=0.15), 5)
    isola = trace(problem, "omega", (0.8, 2.6), start=find_all(problem, at={"omega": 1.9})[-1], stability=None)
    again = trace(problem, "omega", (0.8, 2.6), resume=isola, stability=None)
    assert again.end is End.CLOSED
    assert len(again) == len(isola)


def test_a_branch_can_begin_at_a_fold(problem, branch):
    for fold in branch.folds:
        part = trace(problem, "omega", branch.span, start=fold.solution, stability=None)
        check_branch(part)
        assert part.parameter[0] == fold.value
        assert part.end in {End.SPAN_END, End.SPAN_START}


def test_stability_is_not_lost_where_a_branch_is_resumed(problem, branch):
    without = trace(problem, "omega", (0.5, 1.0), stability=None)
    with pytest.raises(ValueError, match="traced without multipliers: resume it with stability=None"):
        trace(problem, "omega", branch.span, resume=without)
    with pytest.raises(ValueError, match="traced with multipliers: resume it with stability=Floquet"):
        trace(problem, "omega", branch.span, resume=branch, stability=None)
    assert Tracer(problem, "omega", branch.span, resume=branch).branch().stable is not None


def test_a_solution_of_one_period_starts_a_problem_of_two():
    one = HarmonicBalance(duffing(), 3)
    two = HarmonicBalance(duffing(), 6, periods=2)
    solution = solve(one, at={"omega": 1.1})
    again = solve(two, at={"omega": 1.1}, guess=solution)
    assert again.statistics["iterations"] <= 2
    np.testing.assert_allclose(again.coefficients[:, 3:5], solution.coefficients[:, 1:3], atol=1e-12)
    with pytest.raises(ValueError, match=r"2 period\(s\) and the problem 1"):
        solve(one, at={"omega": 1.1}, guess=again)
