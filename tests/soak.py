"""Ctrl-C at random times through every long verb: what becomes of it, and whether anything is lost.

``python tests/soak.py 40`` interrupts each verb 40 times, ``python tests/soak.py 40 trace peaks`` only these, and says
what became of it; a few of each are a test. Another process sends the signals, as a terminal does: one from a thread
would wait for compiled code to return.
"""

import collections
import contextlib
import json
import logging
import signal
import subprocess
import sys
import time
import traceback

import numpy as np
from soak_verbs import VERBS, Verb

SENDER = """
import os, signal, sys, time
for line in sys.stdin:
    time.sleep(float(line))
    os.kill(os.getppid(), signal.SIGINT)
"""
RAISED, RETURNED, AGAIN, LATE = "raised", "returned what there was", "sent again", "late"
GOOD = {RAISED, RETURNED, AGAIN, LATE}


class Interrupter:
    """Sends SIGINT to this process after so many seconds, and counts those that arrive."""

    def __init__(self):
        self.arrived = self.within = 0
        self.armed, self.where = False, ""
        self._sender = subprocess.Popen([sys.executable, "-c", SENDER], stdin=subprocess.PIPE, text=True)
        self._before = signal.signal(signal.SIGINT, self._count)

    def _count(self, _number, frame):
        self.arrived += 1
        self.where = "".join(traceback.format_stack(frame))
        if self.armed and frame.f_code is not interrupt.__code__:  # there the verb is over
            self.within += 1
            raise KeyboardInterrupt

    def send_after(self, seconds):
        self.arrived = self.within = 0
        self.armed = True
        self._sender.stdin.write(f"{seconds:.6f}\n")
        self._sender.stdin.flush()

    def wait(self):
        """Wait for one that was sent and has not arrived."""
        while not self.arrived:
            time.sleep(0.01)

    def is_sent_again(self):
        """Wait for one that was sent again, in vain after ten seconds."""
        for _ in range(1000):
            if self.arrived > 1:
                return True
            time.sleep(0.01)
        return False

    def close(self):
        self._sender.stdin.close()
        self._sender.wait()
        signal.signal(signal.SIGINT, self._before)


class LastWords(logging.Handler):
    """Keeps the last warning: a list of solutions has no other place to say that its search was interrupted."""

    def __init__(self):
        super().__init__(logging.WARNING)
        self.words = ""

    def emit(self, record):
        self.words = record.getMessage()


@contextlib.contextmanager
def interrupter():
    """Give an interrupter for the time of a block."""
    sender = Interrupter()
    try:
        yield sender
    finally:
        sender.close()


@contextlib.contextmanager
def last_words():
    """Listen to what hbnlp logs for the time of a block."""
    listener = LastWords()
    logging.getLogger("hbnlp").addHandler(listener)
    try:
        yield listener
    finally:
        logging.getLogger("hbnlp").removeHandler(listener)


def interrupt(verb: Verb, seconds: float, sender: Interrupter) -> str:
    """Return what became of an interrupt after so many seconds: one of `GOOD`, or what went wrong."""
    told = 0

    def count(progress):
        nonlocal told
        if not progress.done:
            told = next(iter(progress.counts.values()))

    with last_words() as listener:
        try:
            sender.send_after(seconds)
            result = verb.call(count)
            arrived, sender.armed = sender.within, False
        except KeyboardInterrupt:
            outcome = f"all {told} lost" if verb.size is not None and told else RAISED
        except BaseException as error:  # noqa: BLE001 - whatever else comes is wrong
            outcome = f"{type(error).__name__}: {error}"
        else:
            outcome = _judged(verb, result, told, listener.words, sender) if arrived else LATE
    sender.armed = False
    sender.wait()
    if verb.after is not None:
        verb.after()
    return outcome


def _judged(verb, result, told, words, sender):
    if verb.size is None:
        return "swallowed"
    if "interrupted" not in f"{words} {verb.message(result)}":
        return AGAIN if sender.is_sent_again() else "swallowed"
    return RETURNED if verb.size(result) >= told else f"{told - verb.size(result)} of {told} lost"


def soak(verb: Verb, times: int, rng: np.random.Generator, sender: Interrupter) -> tuple[collections.Counter, float]:
    """Interrupt a verb at times drawn from what it takes; return how often what came of it, and the longest wait."""
    verb.call(lambda _progress: None)  # compiles
    begin = time.perf_counter()
    verb.call(lambda _progress: None)
    takes = time.perf_counter() - begin
    outcomes, longest = collections.Counter(), 0.0
    for _ in range(times):
        seconds = rng.uniform(0.0, takes)
        begin = time.perf_counter()
        outcome = interrupt(verb, seconds, sender)
        longest = max(longest, time.perf_counter() - begin - seconds)
        outcomes[outcome] += 1
        if outcome not in GOOD:
            sys.stderr.write(f"{outcome}; it arrived here:\n{sender.where}")
    verb.call(lambda _progress: None)  # nothing was left half done that would be in the way
    return outcomes, longest


def main():
    times = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    total = collections.Counter()
    with interrupter() as sender:
        for name in sys.argv[2:] or VERBS:
            outcomes, longest = soak(VERBS[name](), times, np.random.default_rng(0), sender)
            sys.stdout.write(f"{name:24} {json.dumps(outcomes)}, all over {longest:.2f} s later at most\n")
            sys.stdout.flush()
            total += outcomes
    sys.stdout.write(f"all: {json.dumps(total)}\n")
    return 0 if total.keys() <= GOOD else 1


if __name__ == "__main__":
    sys.exit(main())
