"""Ctrl-C is noted during work and raised between calls of compiled code; nothing is swallowed, nothing is lost."""

import signal
import threading
from contextlib import suppress

import casadi as ca
import numpy as np
import pytest

import hbnlp
from hbnlp.core.interrupts import INTERRUPTS, check_interrupts, interrupts_at_once, interrupts_kept
from hbnlp.solutions.ipopt import Solver


@pytest.fixture(autouse=True)
def _interruptible():
    """A process started in the background ignores Ctrl-C; Python then does not raise KeyboardInterrupt."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    assert signal.signal(signal.SIGINT, before) is signal.default_int_handler
    assert not INTERRUPTS.noted


def interrupt():
    signal.raise_signal(signal.SIGINT)


def swallow():
    with suppress(KeyboardInterrupt):
        interrupt()


def test_an_interrupt_waits_for_the_end_of_the_block():
    done = []
    with pytest.raises(KeyboardInterrupt), interrupts_kept():
        interrupt()
        done.append("what was begun")
    assert done


def test_an_interrupt_is_raised_by_the_next_check():
    with interrupts_kept():
        check_interrupts()
    with pytest.raises(KeyboardInterrupt), interrupts_kept():
        interrupt()
        check_interrupts()
        pytest.fail("it went on")


def test_a_second_interrupt_is_raised_at_once():
    with pytest.raises(KeyboardInterrupt), interrupts_kept():
        interrupt()
        interrupt()
        pytest.fail("it went on")


def test_a_swallowed_interrupt_is_raised_after_the_block():
    swallow()
    with pytest.raises(KeyboardInterrupt), interrupts_kept(), interrupts_at_once():
        swallow()


def test_an_interrupt_is_raised_at_once_in_what_may_last():
    with pytest.raises(KeyboardInterrupt), interrupts_kept(), interrupts_at_once():
        interrupt()
        pytest.fail("it went on")


def test_an_interrupt_turned_into_an_error_is_an_interrupt_again():
    with pytest.raises(KeyboardInterrupt), interrupts_kept():
        interrupt()
        raise RuntimeError("rhs failed")


def test_an_interrupt_that_a_result_speaks_of_is_forgotten():
    with interrupts_kept() as interrupts:
        interrupt()
        assert interrupts.taken()
        assert not interrupts.taken()
        check_interrupts()


def test_blocks_stand_in_each_other():
    done = []
    with pytest.raises(KeyboardInterrupt), interrupts_kept():
        with interrupts_kept():
            done.append(1)
        with interrupts_at_once(), interrupts_kept():
            interrupt()
            done.append(2)
        done.append(3)
    assert done == [1, 2]


def test_other_errors_and_results_pass():
    with pytest.raises(RuntimeError, match="of its own"), interrupts_kept():
        raise RuntimeError("of its own")
    with interrupts_kept():
        result = 3
    assert result == 3


def test_a_handler_of_the_users_is_asked_and_may_raise_what_it_likes():
    class Stop(Exception):
        pass

    def raising(number, frame):
        raise Stop

    heard = []
    signal.signal(signal.SIGINT, lambda number, _: heard.append(number))
    with interrupts_kept():
        interrupt()
        check_interrupts()
    assert heard == [signal.SIGINT]
    signal.signal(signal.SIGINT, raising)
    with pytest.raises(Stop), interrupts_kept():
        interrupt()
        heard.append("before it is raised")
    assert len(heard) == 2
    signal.signal(signal.SIGINT, signal.default_int_handler)


def test_it_does_nothing_where_interrupts_are_ignored():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with interrupts_kept():
        interrupt()
        check_interrupts()
    assert signal.signal(signal.SIGINT, signal.default_int_handler) is signal.SIG_IGN


def test_another_thread_neither_takes_nor_ends_for_an_interrupt_of_the_main_thread():
    went_on = []

    def work():
        with interrupts_kept() as interrupts:
            check_interrupts()
            went_on.append(not interrupts.taken())

    def in_thread():
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()

    in_thread()
    with pytest.raises(KeyboardInterrupt), interrupts_kept():
        interrupt()
        in_thread()
    assert went_on == [True, True]


def test_ipopt_ends_after_the_iteration_in_which_it_is_interrupted():
    class Interrupting(ca.Callback):
        evaluations = 0

        def __init__(self):
            super().__init__()
            self.construct("objective", {"enable_fd": True})

        def eval(self, arguments):
            self.evaluations += 1
            if self.evaluations == 10:
                interrupt()
            x = arguments[0]
            return [(1 - x) ** 4]

    objective, x = Interrupting(), ca.MX.sym("x")
    options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "hessian_approximation": "limited-memory"}}
    solver = Solver({"x": x, "p": ca.MX(0, 1), "f": objective(x), "g": ca.MX(0, 1)}, options)
    with pytest.raises(KeyboardInterrupt), interrupts_kept():
        solver(x0=30.0)
    interrupted = objective.evaluations
    _, statistics = solver(x0=30.0)
    assert statistics["success"]
    assert objective.evaluations - interrupted > 3 * interrupted


def test_an_integration_keeps_its_windows_and_says_so(caplog):
    def callback(progress):
        if progress.counts["periods"] == 5:
            interrupt()

    system = hbnlp.systems.duffing()
    response = hbnlp.integrate(system, at={"omega": 1.2}, callbacks=[callback])
    assert response.n_periods == len(response.defects) == 5
    assert not response.periodic
    assert response.message == "interrupted after 5 periods; go on from start=response"
    assert "integrating: interrupted after 5 periods" in caplog.text
    whole = hbnlp.integrate(system, at={"omega": 1.2})
    rest = hbnlp.integrate(system, at={"omega": 1.2}, start=response)
    assert rest.n_periods == whole.n_periods - 5
    assert np.array_equal(rest.state, whole.state)


@pytest.mark.parametrize("late", ["while the record is made", "in a callback that is told of the end"])
def test_an_interrupt_at_the_very_end_loses_nothing(late, monkeypatch):
    def callback(progress):
        if progress.done and late.startswith("in a callback"):
            interrupt()

    made = hbnlp.branches.tracing.Tracer.branch

    def branch(*arguments):
        if late.startswith("while") and not done:
            done.append(True)
            interrupt()
            check_interrupts()
        return made(*arguments)

    done = []
    monkeypatch.setattr(hbnlp.branches.tracing.Tracer, "branch", branch)
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(), 1)
    traced = hbnlp.trace(problem, "omega", (0.5, 0.7), stability=None, callbacks=[callback])
    assert traced.parameter[-1] == 0.7
    assert traced.end is hbnlp.End.INTERRUPTED
