"""The long verbs, each ready to be interrupted: what it takes to call one, and how much its result holds."""

import atexit
import functools
import shutil
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import hbnlp
from hbnlp import dns
from hbnlp.aero import FrequencyResponse, thin_airfoil
from hbnlp.aero.linear_flow import Case, MeshSettings, run_campaign
from hbnlp.design import Program, Variables, fold_at, response_at
from hbnlp.identification import Identification
from hbnlp.systems import chain, duffing

AT = {"omega": 1.05}
OMEGAS = np.linspace(0.6, 1.4, 200)


@dataclass(frozen=True)
class Verb:
    """A call to be interrupted.

    ``call`` is given a callback. ``size`` says how much a result holds, ``message`` how it ended; a verb without a size
    returns all or raises. ``after`` looks whether what was interrupted can go on.
    """

    call: Callable[[Callable[[Any], None]], Any]
    size: Callable[[Any], int] | None = None
    message: Callable[[Any], str] = lambda result: getattr(result, "message", "")
    after: Callable[[], object] | None = None


@cache
def problem(n_harmonics=5):
    return hbnlp.HarmonicBalance(duffing(), n_harmonics)


@cache
def branch():
    return hbnlp.trace(problem(), "omega", (0.5, 1.6), stability=None)


def new_problem():
    return Verb(lambda _: hbnlp.solve(hbnlp.HarmonicBalance(duffing(), 5), at=AT))


def cold_start():
    hard = [{"omega": omega, "damping_ratio": 1e-3} for omega in (0.9, 1.2, 1.5)]
    return Verb(lambda _: [hbnlp.solve(problem(9), at=at) for at in hard])


def by_ipopt():
    return Verb(lambda _: hbnlp.solve(problem(31), at=AT, method=hbnlp.Ipopt()))


def by_rootfinder():
    return Verb(lambda _: hbnlp.solve(problem(31), at={"omega": 1.5}, method=hbnlp.Rootfinder()))


def program():
    shared = Variables({"force": (0.01, 1.0)})
    points = [response_at(problem(7), shared, hbnlp.solve(problem(7), at={"omega": w})) for w in (0.6, 0.8, 1.5)]
    size = ca.sqrt(problem(7).amplitude_squared("x"))
    bounds = {f"point {i}": (0.0, point(size), 0.5) for i, point in enumerate(points)}
    ready = Program(shared, points, objective=-shared["force"], bounds=bounds, expand=False)
    return Verb(lambda _: ready.solve({"force": 0.1}))


def program_of_a_fold():
    shared = Variables({"cubic": (0.01, 1.0)})
    fold = fold_at(problem(), shared, branch().folds[1], "omega")
    bounds = {"first fold": (1.2, fold.symbol("omega"), np.inf)}
    ready = Program(shared, [fold], objective=shared["cubic"], bounds=bounds, expand=False)
    return Verb(lambda _: ready.solve({"cubic": 0.1}))


def fit():
    shared = Variables({"cubic": (0.01, 1.0), "force": (0.05, 0.5)})
    points = [({"omega": w}, hbnlp.solve(problem(), at={"omega": w})) for w in (0.6, 0.7, 0.8, 0.9, 1.5)]
    measured = [abs(near.harmonics("x")[1]) for _, near in points]
    ready = Identification(shared, problem(), points, "x")
    return Verb(lambda _: ready.fit(measured, {"cubic": 0.2, "force": 0.1}, noise=1e-3))


def peaks():
    traced = hbnlp.trace(hbnlp.HarmonicBalance(chain(4), 5), "omega", (0.3, 2.2), stability=None)
    return Verb(lambda _: hbnlp.peaks(traced, traced.output_names[-1]))


def stability_limits():
    wing = hbnlp.membrane_wing(hbnlp.QuasiLinearMembrane(), thin_airfoil(10))
    return Verb(lambda _: hbnlp.stability_limits(wing, "prestrain", (0.0008, 0.02)))


def lift_response():
    wing = hbnlp.membrane_wing(hbnlp.LinearMembrane(n_modes=6), thin_airfoil(6))
    return Verb(lambda _: hbnlp.lift_response(wing, np.linspace(0.1, 20.0, 100), tensions=4.0))


def floquet():
    solution = hbnlp.solve(problem(31), at=AT)
    return Verb(lambda _: hbnlp.floquet(solution))


def truncation_error():
    solution = hbnlp.solve(problem(31), at=AT)
    return Verb(lambda _: [hbnlp.truncation_error(solution) for _ in range(10)])


def switch_branch():
    traced = hbnlp.trace(hbnlp.HarmonicBalance(chain(3, force=0.3), 5), "omega", (0.3, 3.0))
    points = traced.of_kind(hbnlp.Kind.BRANCH_POINT)[:2]
    return Verb(lambda _: [hbnlp.switch_branch(point) for point in points])


def integrate():
    return Verb(lambda count: hbnlp.integrate(duffing(), at=AT, callbacks=[count]), lambda found: found.n_periods)


def integrate_adaptively():
    system, method = duffing(), hbnlp.Adaptive()
    return Verb(
        lambda count: hbnlp.integrate(system, at=AT, method=method, callbacks=[count]), lambda found: found.n_periods
    )


def trace():
    return Verb(lambda count: hbnlp.trace(problem(9), "omega", (0.5, 1.6), callbacks=[count]), len)


def sweep():
    return Verb(lambda count: hbnlp.sweep(problem(9), "omega", OMEGAS, callbacks=[count]), len)


def sweep_by_integration():
    system = duffing()
    return Verb(
        lambda count: hbnlp.sweep(system, "omega", OMEGAS[::40], callbacks=[count], max_periods=200),
        lambda marched: len(marched.parameter),
    )


def find_all():
    method = hbnlp.Search(n_starts=5)
    return Verb(lambda count: hbnlp.find_all(problem(9), at={"omega": 1.2}, method=method, callbacks=[count]), len)


def follow():
    return Verb(
        lambda count: hbnlp.follow(branch().folds[0], "force", span=(0.15, 0.2), callbacks=[count]),
        len,
        message=lambda folds: str(folds.ends),
    )


def trace_to_a_tolerance():
    tolerant = hbnlp.HarmonicBalance(duffing(damping_ratio=0.05, cubic=1.0, force=0.5), tolerance=1e-4)
    return Verb(lambda count: hbnlp.trace(tolerant, "omega", (0.3, 3.0), callbacks=[count]), len)


def study(executor=None):
    task = functools.partial(hbnlp.trace, problem(), "omega", (0.5, 1.6), stability=None)
    forces = {"force": np.linspace(0.05, 0.2, 6)}
    return Verb(
        lambda count: hbnlp.study(task, over=forces, executor=executor, callbacks=[count]), lambda done: sum(done.done)
    )


def study_by_threads():
    threads = ThreadPoolExecutor(2)
    atexit.register(threads.shutdown)
    return study(threads)


def identify():
    rom, omega = thin_airfoil(6), np.geomspace(0.05, 20.0, 60)
    measured = FrequencyResponse(
        omega=omega,
        values=np.array([rom.transfer(1j * w) for w in omega]),
        static=rom.transfer(0.0).real,
        base_load=np.zeros(7),
    )
    return Verb(lambda _: hbnlp.aero.identify(measured))


def flow():
    def simulation():
        return dns.Simulation(dns.Grid.around_plate(cells=16, levels=2), dns.SharpPlate(n_modes=3))

    whole = simulation().run(0.5)
    under_way = []

    def run(_):
        under_way[:] = [simulation()]
        return under_way[0].run(0.5)

    def goes_on():
        for flow in under_way:
            history = flow.run(0.5)
            assert np.array_equal(history.lift, whole.lift), "a flow that was interrupted went on otherwise"

    return Verb(run, after=goes_on)


def campaign():
    case = Case(n_modes=1, order=2, mesh=MeshSettings(domain=30.0, plate=0.25, wake=2.0, growth=0.7, edge=1e-2))
    folder = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder)
    runs = []

    def run(_):
        runs.append(folder)
        go_on()

    def go_on():
        run_campaign(folder / f"{len(runs)}.npz", case=case, omega=[0.5, 2.0])

    return Verb(run, after=go_on)


VERBS = {
    verb.__name__: verb
    for verb in (
        *(new_problem, cold_start, by_ipopt, by_rootfinder, program, program_of_a_fold, fit, peaks, stability_limits),
        *(lift_response, floquet, truncation_error, switch_branch, integrate, integrate_adaptively, trace, sweep),
        *(sweep_by_integration, find_all, follow, trace_to_a_tolerance, study, study_by_threads),
        *(identify, flow, campaign),
    )
}
