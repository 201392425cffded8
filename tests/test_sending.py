"""What can leave the process: systems with lambdas, problems, records, options and errors; and what cannot, and why."""

import copy
import copyreg
import pickle
import threading

import casadi as ca
import numpy as np
import pytest
from jobs import there

import hbnlp
from hbnlp import dns
from hbnlp.core.errors import HbnlpError
from hbnlp.core.kept import Kept

EVERY_WAY = pytest.mark.parametrize("sent", [there, copy.deepcopy, copy.copy], ids=["pickle", "deepcopy", "copy"])


def with_lambdas():
    """Return a system with everything that a user may write as a function."""
    return hbnlp.System(
        lambda p: [[p.mass]],
        [[0.1]],
        lambda p: [[1.0 + 0.01 * p.omega]],
        nonlinear_force=lambda q, v, tau, p: [p.cubic * q[0] ** 3 + 0.02 * ca.tanh(v[0]) + 0.01 * q[0] * ca.sin(tau)],
        forcing=lambda tau, p: [p.force * ca.cos(tau)],
        parameters={"mass": 1.0, "cubic": 0.3, "force": 0.2},
        outputs={"x": lambda s: s.q[0], "load": lambda s: s.x[0] + s.ddu[0] * s.p.mass},
        lag_state=[[-0.5]],
        lag_input=[[0.3]],
        lag_output=lambda p: [[0.1 * p.mass]],
        motion=lambda tau, p: [0.1 * ca.sin(tau)],
        input_mass=lambda p: [[p.mass]],
        name="everything",
    )


@pytest.fixture(scope="module")
def problem():
    return hbnlp.HarmonicBalance(hbnlp.systems.duffing(), 5)


@pytest.fixture(scope="module")
def branch(problem):
    return hbnlp.trace(problem, "omega", (0.5, 1.6), at={"force": 0.2})


def same(one, other):
    np.testing.assert_array_equal(one.coefficients, other.coefficients)
    np.testing.assert_array_equal(one.amplitudes, other.amplitudes)


@EVERY_WAY
def test_a_branch_of_a_system_that_was_sent_is_the_same_to_the_last_bit(sent):
    original = hbnlp.HarmonicBalance(with_lambdas(), 3)
    other = sent(original)
    assert other is not original
    assert other.system.output_names == original.system.output_names
    assert repr(other) == repr(original)
    one, two = (hbnlp.trace(each, "omega", (0.5, 1.3)) for each in (original, other))
    same(one, two)
    np.testing.assert_array_equal(one.multipliers, two.multipliers)
    assert [p.value for p in one.special_points] == [p.value for p in two.special_points]


@EVERY_WAY
def test_records_keep_their_numbers_and_one_problem_for_all_their_solutions(sent, branch):
    other = sent(branch)
    same(branch, other)
    assert repr(other) == repr(branch)
    assert other.problem is other.folds[0].solution.problem
    same(other.solution(3), branch.solution(3))
    same(other.at(0.9)[0], branch.at(0.9)[0])
    same(hbnlp.peaks(other, "x")[0].solution, hbnlp.peaks(branch, "x")[0].solution)


@EVERY_WAY
def test_with_a_tolerance_every_point_keeps_its_own_harmonics(sent):
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(damping_ratio=0.05, cubic=1.0, force=0.5), tolerance=1e-4)
    other = sent(problem)
    assert repr(other) == repr(problem)
    one, two = (hbnlp.trace(each, "omega", (0.6, 3.0), stability=None) for each in (problem, other))
    same(one, two)
    assert len({*one.n_harmonics}) > 1
    np.testing.assert_array_equal(one.n_harmonics, two.n_harmonics)
    np.testing.assert_array_equal(one.truncation_error, two.truncation_error)
    branch = sent(one)
    for index in (0, len(one) - 1):
        assert branch.solution(index).problem is branch.problem.with_harmonics(one.n_harmonics[index])
    same(branch.at(0.9)[0], one.at(0.9)[0])


def test_all_other_records_and_options_can_be_sent(problem, branch):
    fold = branch.folds[0]
    solution = hbnlp.solve(problem, at={"omega": 0.8})
    variables = hbnlp.design.Variables({"force": (0.1, 0.3)})
    response = hbnlp.design.response_at(problem, variables, solution)
    program = hbnlp.design.Program(variables, [response], objective=response(problem.amplitude_squared("x")))
    wing = hbnlp.membrane_wing(hbnlp.QuasiLinearMembrane(n_modes=2), hbnlp.aero.thin_airfoil(2))
    records = [
        solution,
        fold,
        hbnlp.floquet(solution),
        hbnlp.find_all(problem, at={"omega": 0.8}, method=hbnlp.Search(n_starts=1)),
        hbnlp.follow(fold, "force", span=(0.15, 0.25)),
        hbnlp.trace(hbnlp.HarmonicBalance(problem.system, tolerance=1e-2), "omega", (0.5, 1.6), stability=None),
        hbnlp.sweep(problem, "omega", [0.6, 0.7]),
        hbnlp.sweep(problem.system, "omega", [0.6], method=hbnlp.RungeKutta4()),
        hbnlp.integrate(problem.system, at={"omega": 0.6}),
        program.solve({"force": 0.2}),
        hbnlp.aero.thin_airfoil(2),
        hbnlp.aero.flat_plate_re100_response(),
        hbnlp.lift_response(wing, [0.5], tensions=[4.0]),
        dns.Motion.at_incidence(2.0),
        dns.Motion.sinusoidal(2.0, pitch=0.1),
        dns.SharpPlate.oscillating(2.0, [0.1]),
        *(make() for make in (hbnlp.Newton, hbnlp.Ipopt, hbnlp.Rootfinder, hbnlp.Search, hbnlp.PseudoArclength)),
        *(make() for make in (hbnlp.Floquet, hbnlp.RungeKutta4, hbnlp.Adaptive, hbnlp.ProgressBar)),
        *(make() for make in (hbnlp.LinearMembrane, hbnlp.QuasiLinearMembrane, hbnlp.NonlinearMembrane)),
        hbnlp.Autosave("branch.npz"),
    ]
    for record in records:
        for other in (there(record), copy.deepcopy(record)):
            assert type(other) is type(record)
            if "object at" not in repr(record):
                assert repr(other) == repr(record)


def test_the_arrays_of_a_rom_cannot_be_written_to_where_they_arrive():
    rom = there(hbnlp.aero.thin_airfoil(2))
    with pytest.raises(ValueError, match="read-only"):
        rom.damping[0, 0] = 1.0


@pytest.mark.parametrize(
    ("membrane", "most"), [(hbnlp.QuasiLinearMembrane(), 85_000), (hbnlp.NonlinearMembrane(), 120_000)]
)
def test_a_wing_is_some_tens_of_kilobytes_whatever_was_compiled(membrane, most):
    wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100())
    problem = hbnlp.HarmonicBalance(wing, 5)
    hbnlp.solve(problem, at={"omega": 2.0, "pitch_amplitude": 0.01})
    assert len(pickle.dumps(problem)) < most


def test_what_arrives_twice_is_built_once_and_compiled_once(problem):
    one, two = there(problem), there(problem)
    assert one is two
    assert one.system is two.system
    assert pickle.dumps(one) == pickle.dumps(problem)
    assert hbnlp.HarmonicBalance(one.system, 5) is not one


def test_relatives_of_a_balance_meet_again_where_they_arrive(problem):
    finer = problem.with_harmonics(9)
    one, two = there((problem, finer))
    assert one.with_harmonics(9) is two


def test_copies_share_nothing(problem):
    other = copy.deepcopy(problem)
    assert other.system is not problem.system
    assert other.system.lag_state is not problem.system.lag_state
    assert copy.deepcopy(problem) is not other


def test_the_multipliers_of_a_solution_that_was_sent_compile_nothing_anew(problem, monkeypatch):
    one, two = (there(hbnlp.solve(problem, at={"omega": w})) for w in (0.7, 0.8))
    hbnlp.floquet(one)
    monkeypatch.setattr("hbnlp.stability.multipliers.Linearisation", None)
    hbnlp.floquet(two)


@pytest.mark.parametrize("sent", [pickle.dumps, copy.deepcopy], ids=["pickle", "deepcopy"])
def test_what_cannot_be_sent_says_what_to_do(problem, sent):
    variables = hbnlp.design.Variables({"force": (0.1, 0.3)})
    solution = hbnlp.solve(problem, at={"omega": 0.8})
    response = hbnlp.design.response_at(problem, variables, solution)
    program = hbnlp.design.Program(variables, [response], objective=response(problem.amplitude_squared("x")))
    for thing, remedy in (
        (variables, "send the bounds"),
        (response, "send the problem and the solution"),
        (program, "send problems and solutions"),
        (hbnlp.Tracer(problem, "omega", (0.5, 1.6)), r"send its branch\(\)"),
    ):
        with pytest.raises(TypeError, match=f"a {type(thing).__name__} cannot be pickled or copied: .*{remedy}"):
            sent(thing)


class Cube(ca.Callback):
    """What is Python of its process by its nature."""

    def __init__(self):
        super().__init__()
        self.construct("cube", {"enable_fd": True})

    def eval(self, arguments):
        return [arguments[0] ** 3]


def test_a_system_that_calls_into_this_process_is_refused_here_and_not_in_the_worker():
    cube = Cube()
    system = hbnlp.System(
        [[1]], [[0.1]], [[1]], nonlinear_force=lambda q, v, tau, p: [cube(q[0])], parameters={"omega": 1.0}, name="own"
    )
    problem = hbnlp.HarmonicBalance(system, 1)
    for sent in (pickle.dumps, copy.deepcopy):
        for thing in (system, problem):
            with pytest.raises(TypeError, match=r"system .own. cannot be pickled or copied: its force .*in the worker"):
                sent(thing)


def subclasses(kind):
    return {kind}.union(*(subclasses(each) for each in kind.__subclasses__()))


@pytest.fixture
def _own_pickling():
    """Dask, once imported, has errors pickled in its own way, with their causes."""
    others = {kind: how for kind, how in copyreg.dispatch_table.items() if issubclass(kind, BaseException)}
    for kind in others:
        del copyreg.dispatch_table[kind]
    yield
    copyreg.dispatch_table.update(others)


@pytest.mark.usefixtures("_own_pickling")
def test_every_error_keeps_its_message_attributes_and_notes():
    arguments = {
        hbnlp.ConvergenceError: ("no", [1]),
        hbnlp.TaskError: ("tracing", [1], ValueError("why")),
        hbnlp.SaveError: (28, "no space", "file"),
    }
    for kind in {k for k in subclasses(HbnlpError) if k.__module__ == "hbnlp.core.errors"}:
        error = kind(*arguments.get(kind, ("what",)))
        error.add_note("at omega = 2")
        error.__cause__ = ValueError("why")
        other = there(there(error))
        assert type(other) is kind
        assert str(other) == str(error)
        assert getattr(other, "result", None) == getattr(error, "result", None)
        assert other.__notes__ == ["at omega = 2", "caused by ValueError: why"]
        assert error.__notes__ == ["at omega = 2"]
        if kind is hbnlp.SaveError:
            assert (other.errno, other.filename) == (28, "file")


def test_threads_that_ask_for_different_objects_do_not_wait_for_each_other():
    kept, building, go_on = Kept(3), threading.Event(), threading.Event()
    kept.get("known", lambda: 1)
    slow = threading.Thread(target=lambda: kept.get("slow", lambda: building.set() or go_on.wait(5.0)))
    slow.start()
    assert building.wait(5.0)
    assert kept.get("known", lambda: 2) == 1
    go_on.set()
    slow.join()
