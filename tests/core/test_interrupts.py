"""Ctrl-C is noted during work and raised between calls of compiled code; nothing is swallowed, nothing is lost."""

import signal
import threading
import time
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


@interrupts_kept()
def work(*steps):
    """Do some steps, with what to write down among them."""
    for step in steps:
        step()


@interrupts_kept()
def work_that_may_last(*steps):
    with interrupts_at_once():
        work.__wrapped__(*steps)


def wait():
    for _ in range(6000):
        time.sleep(0.01)


class Log(list):
    def of(self, word):
        return lambda: self.append(word)


@pytest.fixture
def log():
    return Log()


def fail():
    raise RuntimeError("rhs failed")


def test_an_interrupt_waits_for_the_end_of_the_work(log):
    with pytest.raises(KeyboardInterrupt):
        work(interrupt, log.of("what was begun"))
    assert log == ["what was begun"]


def test_an_interrupt_is_raised_by_the_next_check(log):
    with pytest.raises(KeyboardInterrupt):
        work(check_interrupts, log.of(1), interrupt, log.of(2), check_interrupts, log.of(3))
    assert log == [1, 2]


def test_a_second_interrupt_is_raised_at_once(log):
    with pytest.raises(KeyboardInterrupt):
        work(interrupt, log.of(1), interrupt, log.of(2))
    assert log == [1]


def test_an_interrupt_is_raised_at_once_in_what_may_last(log):
    with pytest.raises(KeyboardInterrupt):
        work_that_may_last(log.of(1), interrupt, log.of(2))
    assert log == [1]


def test_a_swallowed_interrupt_is_raised_after_what_swallowed_it(log):
    swallow()
    with pytest.raises(KeyboardInterrupt):
        work_that_may_last(swallow, log.of(1))
    assert log == [1]


@pytest.mark.parametrize("kind", [work, work_that_may_last])
def test_an_error_that_an_interrupt_was_turned_into_is_an_interrupt_again(kind):
    with pytest.raises(KeyboardInterrupt):
        kind(swallow, fail)


def test_other_errors_and_results_pass():
    with pytest.raises(RuntimeError, match="rhs failed"):
        work(fail)
    assert interrupts_kept()(lambda: 3)() == 3


def test_an_interrupt_that_a_result_speaks_of_is_forgotten():
    with interrupts_kept() as interrupts:
        interrupt()
        assert interrupts.taken()
        assert not interrupts.taken()
        check_interrupts()


def test_work_stands_in_other_work(log):
    with pytest.raises(KeyboardInterrupt):
        work(lambda: work(log.of(1)), lambda: work_that_may_last(lambda: work(interrupt, log.of(2))), log.of(3))
    assert log == [1, 2]


def test_what_comes_while_the_handler_is_put_back_is_raised(log):
    class Late(type(INTERRUPTS)):
        def _leave(self, **options):
            interrupt()
            super()._leave(**options)

    with pytest.raises(KeyboardInterrupt):
        Late().kept()(log.of(1))()
    assert log == [1]


def test_what_comes_too_late_for_a_result_is_sent_again_when_the_caller_has_it(log):
    result = interrupts_kept(returns=True)(lambda: interrupt() or "all that was computed")()
    with pytest.raises(KeyboardInterrupt):
        wait()
    assert result == "all that was computed"
    with pytest.raises(KeyboardInterrupt):
        interrupts_kept(returns=True)(work)(interrupt, check_interrupts, log.of(1))
    assert not log


def test_a_handler_of_the_users_is_asked_and_may_raise_what_it_likes(log):
    class Stop(Exception):
        pass

    def raising(*_):
        raise Stop

    signal.signal(signal.SIGINT, lambda *_: log.append("heard"))
    work(interrupt, check_interrupts, log.of(1))
    signal.signal(signal.SIGINT, raising)
    with pytest.raises(Stop):
        work(interrupt, log.of(2))
    signal.signal(signal.SIGINT, signal.default_int_handler)
    assert log == ["heard", 1, 2]


def test_where_interrupts_are_ignored_they_still_are(log):
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    work(interrupt, check_interrupts, log.of(1))
    assert signal.signal(signal.SIGINT, signal.default_int_handler) is signal.SIG_IGN
    assert log == [1]


def test_another_thread_neither_takes_nor_ends_for_an_interrupt_of_the_main_thread(log):
    def beside():
        thread = threading.Thread(target=work, args=[check_interrupts, lambda: log.append(INTERRUPTS.taken())])
        thread.start()
        thread.join()

    beside()
    with pytest.raises(KeyboardInterrupt):
        work(interrupt, beside)
    assert log == [False, False]


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
