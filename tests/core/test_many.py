"""Many calls by workers: each worker is sent the function once, and what has ended is never lost."""

import multiprocessing
import pickle
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor

import jobs
import pytest

from hbnlp.core import many, sent_once


def times_ten(number):
    return 10 * number


def run(executor, function=times_ten, n=40):
    found = {}
    order = list(many.each_of(function, range(n), found.__setitem__, executor=executor))
    assert sorted(order) == list(range(n))
    return found


class Recording(Executor):
    """Calls at once, each on a worker that a rule names, and keeps what was sent."""

    def __init__(self, worker_of):
        self.calls, self._worker_of = [], worker_of

    def submit(self, _answered, call):
        self.calls.append(call)
        future = Future()
        worker = self._worker_of(len(self.calls))
        known = worker in {w for w, c in zip(map(self._worker_of, range(1, len(self.calls))), self.calls) if c.function}  # noqa: B905
        value = None if call.function is None and not known else pickle.loads(call_function(call, self))(call.argument)  # noqa: S301
        future.set_result(sent_once.Answer(("host", worker), value, unknown=call.function is None and not known))
        return future


def call_function(call, executor):
    return call.function or next(c.function for c in executor.calls if c.function)


@pytest.mark.parametrize("executor", [None, ThreadPoolExecutor(3)], ids=["loop", "threads"])
def test_here_a_function_need_not_be_sent(executor):
    assert run(executor, lambda number: 10 * number) == {i: 10 * i for i in range(40)}


def test_a_pool_of_processes_gives_what_a_loop_gives():
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        assert run(pool, jobs.twice, 100) == {i: 2 * i for i in range(100)}


@pytest.mark.parametrize("workers", [1, 16, 30])
def test_a_worker_that_asks_is_sent_the_function_once(workers):
    executor = Recording(lambda number: number % workers)
    assert run(executor, n=200) == {i: 10 * i for i in range(200)}
    carrying = [call for call in executor.calls if call.function]
    assert len(carrying) <= many.CARRYING + workers
    assert len(executor.calls) <= 2 * 200


def test_workers_that_forget_at_once_are_sent_it_again_and_again():
    executor = Recording(lambda number: number)  # each call by a worker that never saw one
    assert run(executor, n=50) == {i: 10 * i for i in range(50)}
    assert len(executor.calls) <= 3 * 50


def test_tickets_tell_equal_calls_apart():
    executor = Recording(lambda _: 0)
    for _ in range(2):
        run(executor, n=5)
    assert len({call.ticket for call in executor.calls}) == len(executor.calls)


def test_a_function_that_no_process_can_be_sent_is_refused_by_name():
    lock = multiprocessing.Lock()
    with pytest.raises(TypeError, match="cannot be sent to other processes"):
        run(Recording(lambda _: 0), lambda number: lock)


def test_a_worker_that_cannot_read_the_function_ends_the_work():
    call = sent_once.Call(b"a token of its own", b"no pickle", 1, "a")
    with pytest.raises(sent_once.UnreadableTaskError, match="cannot be read by a worker"):
        sent_once.answered(call)
    assert sent_once.answered(sent_once.Call(b"another", None, 1, "b")).unknown


def test_what_has_ended_is_taken_when_the_work_is_left():
    taken = {}
    work = many.each_of(times_ten, range(20), taken.__setitem__, executor=Recording(lambda _: 0))
    next(work)
    work.close()
    assert taken == {i: 10 * i for i in range(20)}
