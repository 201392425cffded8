"""An interrupt that compiled code swallows is raised all the same."""

import signal
import threading
from contextlib import suppress

import pytest

from hbnlp.core.interrupts import interrupts_kept


@pytest.fixture(autouse=True)
def _interruptible():
    """A process started in the background ignores Ctrl-C; Python then does not raise KeyboardInterrupt."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def swallow():
    with suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_a_swallowed_interrupt_is_raised_after_the_block():
    before = signal.getsignal(signal.SIGINT)
    swallow()
    with pytest.raises(KeyboardInterrupt), interrupts_kept():
        swallow()
    assert signal.getsignal(signal.SIGINT) is before


def test_an_interrupt_turned_into_an_error_is_an_interrupt_again():
    def fail():
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise RuntimeError("rhs failed") from None

    with pytest.raises(KeyboardInterrupt), interrupts_kept():
        fail()


def test_other_errors_and_results_pass():
    with pytest.raises(RuntimeError, match="of its own"), interrupts_kept():
        raise RuntimeError("of its own")
    with interrupts_kept():
        result = 3
    assert result == 3


def test_it_does_nothing_in_another_thread():
    done = []

    def work():
        with interrupts_kept():
            done.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [True]
