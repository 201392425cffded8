"""Ctrl-C at random times through every long verb: what becomes of it, and whether anything is lost.

``python tests/soak.py 40`` interrupts each verb 40 times and prints what became of it; a few of each are a test.
Another process sends the signals, as a terminal does: one from a thread would wait for compiled code to return.
"""

import collections
import json
import logging
import os
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import hbnlp
from hbnlp import dns
from hbnlp.aero import thin_airfoil
from hbnlp.design import Program, Variables, fold_at, response_at
from hbnlp.identification import Identification
from hbnlp.systems import chain, duffing

SENDER = """
import os, signal, sys, time
for line in sys.stdin:
    time.sleep(float(line))
    os.kill(os.getppid(), signal.SIGINT)
"""
RAISED, RETURNED, LATE = "raised", "returned", "late"
GOOD = {RAISED, RETURNED, LATE}


@dataclass(frozen=True)
class Verb:
    """A call to be interrupted.

    ``call`` is given a callback, and returns what the verb does; ``size`` is how much a result holds, and ``told`` how
    much a callback was told of. Without them the verb returns all or raises.
    """

    call: Callable[[Callable[[Any], None]], Any]
    size: Callable[[Any], int] | None = None
    told: Callable[[Any], int] = lambda progress: next(iter(progress.counts.values()))
    interrupted: Callable[[Any], bool] = lambda result: "interrupted" in result.message
    after: Callable[[], None] = lambda: None


class Interrupter:
    """Sends SIGINT to this process after so many seconds, and counts those that arrive."""

    def __init__(self) -> None:
        self.arrived, self.where = 0, ""
        self._sender = subprocess.Popen([sys.executable, "-c", SENDER], stdin=subprocess.PIPE, text=True)
        self._before = signal.signal(signal.SIGINT, self._count)

    def _count(self, number, frame):
        self.arrived += 1
        self.where = "".join(traceback.format_stack(frame))
        raise KeyboardInterrupt

    def send_after(self, seconds):
        self.arrived = 0
        self._sender.stdin.write(f"{seconds:.6f}\n")
        self._sender.stdin.flush()

    def wait(self):
        """Wait for one that was sent and has not arrived."""
        try:
            while not self.arrived:
                time.sleep(0.01)
        except KeyboardInterrupt:
            pass

    def close(self):
        self._sender.stdin.close()
        self._sender.wait()
        signal.signal(signal.SIGINT, self._before)


@contextmanager
def interrupter():
    """An interrupter for the time of a block."""
    sender = Interrupter()
    try:
        yield sender
    finally:
        sender.close()


def interrupt(verb: Verb, seconds: float, sender: Interrupter) -> str:
    """Return what became of an interrupt after so many seconds: one of `GOOD`, or what went wrong."""
    told = 0

    def count(progress):
        nonlocal told
        if not progress.done:
            told = verb.told(progress)

    result = None
    try:
        sender.send_after(seconds)
        result = verb.call(count)
        arrived = sender.arrived  # within the call, or at this very line
    except KeyboardInterrupt:
        outcome = f"lost {told}" if verb.size is not None and told else RAISED
    except BaseException as error:  # noqa: BLE001 - any is wrong
        outcome = f"{type(error).__name__}: {error}"[:200]
    else:
        outcome = LATE if not arrived else judged(verb, result, told)
    if outcome not in GOOD:
        print(f"{outcome}; it arrived at\n{sender.where}", file=sys.stderr)
    sender.wait()
    verb.after()
    return outcome


def judged(verb, result, told):
    if verb.size is None or not verb.interrupted(result):
        return "swallowed"
    return RETURNED if verb.size(result) >= told else f"{told - verb.size(result)} of {told} lost"


def soak(verb: Verb, times: int, rng: np.random.Generator, sender: Interrupter) -> tuple[collections.Counter, float]:
    """Interrupt a verb, with times drawn within what it takes; return how often what came of it, and the longest wait."""
    verb.call(lambda _progress: None)  # compiles
    begin = time.perf_counter()
    verb.call(lambda _progress: None)
    takes = time.perf_counter() - begin
    outcomes, longest = collections.Counter(), 0.0
    for _ in range(times):
        seconds = rng.uniform(0.0, takes)
        begin = time.perf_counter()
        outcomes[interrupt(verb, seconds, sender)] += 1
        longest = max(longest, time.perf_counter() - begin - seconds)
    verb.call(lambda _progress: None)  # nothing is left half done that is in the way of going on
    return outcomes, longest


def verbs(folder: Path) -> dict[str, Callable[[], Verb]]:
    """Return what makes each verb ready."""

    def over(call, size=None, **options):
        return lambda: Verb(call, size, **options)

    def duffing_problem(n_harmonics=5):
        return hbnlp.HarmonicBalance(duffing(), n_harmonics)

    def traced():
        return hbnlp.trace(duffing_problem(), "omega", (0.5, 1.6), stability=None)

    def program():
        problem, shared = duffing_problem(7), Variables({"force": (0.01, 1.0)})
        points = [response_at(problem, shared, hbnlp.solve(problem, at={"omega": w})) for w in (0.6, 0.8, 1.5)]
        size = ca.sqrt(problem.amplitude_squared("x"))
        bounds = {f"point {i}": (0.0, point(size), 0.5) for i, point in enumerate(points)}
        ready = Program(shared, points, objective=-shared["force"], bounds=bounds, expand=False)
        return Verb(lambda _: ready.solve({"force": 0.1}))

    def fold_program():
        shared, fold = Variables({"cubic": (0.01, 1.0)}), traced().folds[1]
        ready_fold = fold_at(fold.problem, shared, fold, "omega")
        bounds = {"first fold": (1.2, ready_fold.symbol("omega"), np.inf)}
        ready = Program(shared, [ready_fold], objective=shared["cubic"], bounds=bounds, expand=False)
        return Verb(lambda _: ready.solve({"cubic": 0.1}))

    def fit():
        problem, shared = duffing_problem(), Variables({"cubic": (0.01, 1.0), "force": (0.05, 0.5)})
        points = [({"omega": w}, hbnlp.solve(problem, at={"omega": w})) for w in (0.6, 0.7, 0.8, 0.9, 1.5)]
        measured = [abs(near.harmonics("x")[1]) for _, near in points]
        ready = Identification(shared, problem, points, "x")
        return Verb(lambda _: ready.fit(measured, {"cubic": 0.2, "force": 0.1}, noise=1e-3))

    def flow():
        def simulation():
            return dns.Simulation(dns.Grid.around_plate(cells=16, levels=2), dns.SharpPlate(n_modes=3))

        once = simulation()
        once.run(0.5)
        under_way = [simulation()]

        def run(_):
            under_way[:] = [simulation()]
            return under_way[0].run(0.5)

        def go_on():
            history = under_way[0].run(0.5) if under_way[0].time < 0.5 - 1e-9 else under_way[0].history
            assert np.array_equal(history.lift, once.history.lift), "an interrupted flow went on otherwise"

        return Verb(run, after=go_on)

    def peaks():
        branch = hbnlp.trace(hbnlp.HarmonicBalance(chain(4), 5), "omega", (0.3, 2.2), stability=None)
        return Verb(lambda _: hbnlp.peaks(branch, branch.output_names[-1]))

    def limits():
        wing = hbnlp.membrane_wing(hbnlp.QuasiLinearMembrane(), thin_airfoil(10))
        return Verb(lambda _: hbnlp.stability_limits(wing, "prestrain", (0.0008, 0.02)))

    def campaign():
        from hbnlp.aero.linear_flow import Case, MeshSettings, run_campaign

        case = Case(n_modes=1, order=2, mesh=MeshSettings(domain=30.0, plate=0.25, wake=2.0, growth=0.7, edge=1e-2))
        names = (folder / f"{i}.npz" for i in range(10**9))
        used = []

        def run(_):
            used.append(next(names))
            return run_campaign(used[-1], case=case, omega=[0.5, 2.0, 8.0])

        return Verb(run, after=lambda: run_campaign(used[-1], case=case, omega=[0.5, 2.0, 8.0]) and None)

    def switching():
        branch = hbnlp.trace(hbnlp.HarmonicBalance(chain(3, force=0.3), 5), "omega", (0.3, 3.0))
        points = [p for p in branch.special_points if p.kind is hbnlp.Kind.BRANCH_POINT]
        return Verb(lambda _: [hbnlp.switch_branch(p) for p in points[:2]])

    many, hard = duffing_problem(31), duffing_problem(9)
    branch = traced()
    omegas = np.linspace(0.6, 1.4, 200)
    system, at = duffing(), {"omega": 1.05}
    wing = hbnlp.membrane_wing(hbnlp.LinearMembrane(n_modes=6), thin_airfoil(6))
    resonant = {"omega": 1.2, "damping_ratio": 1e-3}
    response = thin_airfoil(6)

    def identify(_):
        s = np.geomspace(0.05, 20.0, 60)
        values = np.array([response.transfer(1j * w) for w in s])
        measured = hbnlp.aero.FrequencyResponse(
            omega=s, values=values, static=response.transfer(0.0).real, base_load=np.zeros(7)
        )
        return hbnlp.aero.identify(measured)

    return {
        "solve, of a new problem": over(lambda _: hbnlp.solve(duffing_problem(), at=at)),
        "solve, cold": over(lambda _: [hbnlp.solve(hard, at={**resonant, "omega": w}) for w in (0.9, 1.2, 1.5)]),
        "solve, Ipopt": over(lambda _: hbnlp.solve(many, at=at, method=hbnlp.Ipopt())),
        "solve, Rootfinder": over(
            lambda _: [hbnlp.solve(many, at={"omega": 1.5}, method=hbnlp.Rootfinder()) for _ in range(3)]
        ),
        "Program.solve": program,
        "Program.solve of a fold": fold_program,
        "fit": fit,
        "peaks": peaks,
        "stability_limits": limits,
        "lift_response": over(lambda _: hbnlp.lift_response(wing, np.linspace(0.1, 20.0, 400), tensions=4.0)),
        "floquet": over(lambda _: hbnlp.floquet(hbnlp.solve(many, at=at))),
        "truncation_error": over(lambda _: hbnlp.truncation_error(hbnlp.solve(many, at=at))),
        "switch_branch": switching,
        "integrate": over(
            lambda count: hbnlp.integrate(system, at=at, callbacks=[count]), lambda response: response.n_periods
        ),
        "integrate, Adaptive": over(
            lambda count: hbnlp.integrate(system, at=at, method=hbnlp.Adaptive(), callbacks=[count]),
            lambda response: response.n_periods,
        ),
        "trace": over(
            lambda count: hbnlp.trace(hard, "omega", (0.5, 1.6), callbacks=[count]),
            len,
            interrupted=lambda result: result.end is hbnlp.End.INTERRUPTED,
        ),
        "sweep": over(lambda count: hbnlp.sweep(hard, "omega", omegas, callbacks=[count]), lambda s: len(s.parameter)),
        "sweep, by integration": over(
            lambda count: hbnlp.sweep(system, "omega", omegas[::20], callbacks=[count], max_periods=200),
            lambda s: len(s.parameter),
        ),
        "find_all": over(
            lambda count: hbnlp.find_all(
                hard, at={"omega": 1.2}, method=hbnlp.Search(n_starts=10), callbacks=[count]
            ),
            len,
            interrupted=lambda _: "interrupted" in LAST_WORDS.words,
        ),
        "follow": over(
            lambda count: hbnlp.follow(branch.folds[0], "force", callbacks=[count]),
            lambda folds: len(folds.first),
            interrupted=lambda folds: "interrupted" in folds.ends,
        ),
        "resolve_harmonics": over(
            lambda count: hbnlp.resolve_harmonics(branch, 1e-6, callbacks=[count]), len
        ),
        "identify": over(identify),
        "flow": flow,
        "campaign": campaign,
    }  # fmt: skip


class _Words(logging.Handler):
    """Keeps the last warning: a list of solutions has no other place to say that a search was interrupted."""

    words = ""

    def emit(self, record):
        self.words = record.getMessage()


LAST_WORDS = _Words(level=logging.WARNING)


def main():
    times = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    chosen = sys.argv[2:]
    logging.getLogger("hbnlp").addHandler(LAST_WORDS)
    total, wrong = collections.Counter(), {}
    with tempfile.TemporaryDirectory() as folder, interrupter() as sender:
        for name, make in verbs(Path(folder)).items():
            if chosen and name not in chosen:
                continue
            outcomes, longest = soak(make(), times, np.random.default_rng(0), sender)
            print(f"{name:26} {json.dumps(outcomes)}, at most {longest:.2f} s", flush=True)
            total += outcomes
            wrong |= {f"{name}: {word}": count for word, count in outcomes.items() if word not in GOOD}
    print(
        f"{total.total() - total[LATE]} interrupts: {total[RAISED]} raised, {total[RETURNED]} returned what there was, {wrong}"
    )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
