"""A table of wrong kinds, the public callables with a right call of each, and what a refusal is."""

from __future__ import annotations

import functools
import inspect
import linecache
import re
import types
import warnings
from pathlib import Path

import casadi as ca
import numpy as np

import hbnlp
from hbnlp import aero, design, dns, identification, plot, systems

ROOT = Path(hbnlp.__file__).parent
ROOMS = (hbnlp, aero, design, identification, systems, dns, plot)

WRONG = {
    "None": None,
    "text": "x",
    "object": object(),
    "function": lambda *_: None,
    "class": dict,
    "-1": -1,
    "0": 0,
    "2.5": 2.5,
    "nan": np.nan,
    "inf": np.inf,
    "True": True,
    "complex": 1.0 + 2.0j,
    "huge": 10**9,
    "beyond floats": 10**400,
    "texts": ["a", "b"],
    "mapping": {"a": 1},
    "ragged": [[1.0, 2.0], [3.0]],
    "(7, 7, 7)": np.ones((7, 7, 7)),
    "nan array": np.full(3, np.nan),
    "symbol": ca.MX.sym("s"),
    "another record": aero.Provenance(),
}

RIGHT_FOR = {
    "int": {"-1", "0"},
    "float": {"-1", "0", "2.5", "huge"},
    "bool": {"True"},
    "str": {"text"},
    "None": {"None"},
    "Mapping": set(),
    "Callable": {"function", "class"},
    "Callback": {"function", "class"},
    "EventFunction": {"function", "class"},
    "MX": {"symbol"},
    "Provenance": {"another record"},
    "Modal": {"function", "class"},
    "Force|Signal|Motion": {"function", "class"},
    "Matrix": {"-1", "0", "2.5", "True", "huge", "function"},
    "Array": {"-1", "0", "2.5", "huge", "complex", "True", "(7, 7, 7)"},
    "Any": {*WRONG} - {"huge"},
}
"""What an annotation lets through: it may be accepted, and if it is refused, then like everything else."""

LEFT_OUT = {
    ("dns.Simulation.run", "until"): "a run that takes for ever is what was asked for",
    ("dns.step_response", "duration"): "likewise",
    ("dns.linear_response", "periods"): "likewise",
    ("aero.reduce_to_band", "sweeps"): "likewise",
}
"""What is not tried, and why."""

HARMLESS = {
    *(
        "max_iterations",
        "depth",
        "max_points",
        "max_periods",
        "most_poles",
        "n_starts",
        "n_deflated",
        "sweeps",
        "every",
        "index",
    ),
    *("levels", "frames_per_second", "n_lags"),
}
"""Numbers that may be as large as anyone likes: where an end comes earlier, or would be waited for."""

RESULTS = {
    *("Branch", "Diagram", "End", "FloquetResult", "FoldBranch", "FoldEvent", "Kind", "Progress", "ProgressBar"),
    *("Solution", "SolutionSet", "SpecialPoint", "Status", "Sweep", "TimeResponse", "TimeSweep", "Optimum", "Response"),
    *("Identified", "RationalFit", "Realisation", "History", "LinearResponse", "Snapshot", "StepResponse", "Structure"),
    *("Failure", "MeasuredFit", "Study"),
}
"""What the package makes and users do not: not called themselves, though their methods are."""


INNER = {
    *(
        "Adaptive.propagator",
        "RungeKutta4.propagator",
        "ExponentialRungeKutta4.propagator",
        "Rootfinder.solver",
        "HarmonicBalance.samples_suffice",
    ),
    *("HarmonicBalance.aliasing", "HarmonicBalance.carrying", "HarmonicBalance.check_doubling"),
    *("HarmonicBalance.corner", "HarmonicBalance.over_twice_the_period"),
    *("HarmonicBalance.with_enough_samples", "Branch.of_parts"),
    *("System.state_matrices", "Solution.with_coefficients", "Solution.image", "Tracer.branch"),
    *("HarmonicBalance.output_harmonics", "aero.Provenance.warn_outside_band", "dns.History.of", "dns.Snapshot.of"),
    *("Failure.of", "System.warn_of"),
    "identification.Identification.described",
    *("dns.Grid.cell", "dns.Grid.check_inside", "dns.Grid.nodes", "dns.Simulation.restore"),
}
LAWS = re.compile(
    r"(Membrane|Structure)\.(camber|displacement|elongation|energy|mass_matrix|nonlinear_force|restoring_force"
    r"|shape|stiffness_matrix|tangent_stiffness|tension)$"
)
"""Asked by the package itself at every point or step, by symbols and by numbers: they are not to check what comes."""


def callables():
    """Return every public callable by its name: functions, classes, and methods that take an argument."""
    found = {}
    for room in ROOMS:
        for name in room.__all__:
            each = getattr(room, name)
            if inspect.ismodule(each) or not callable(each):
                continue
            if inspect.isclass(each) and issubclass(each, Exception):
                continue
            label = f"{room.__name__}.{name}".removeprefix("hbnlp.")
            if label in found or (room is not hbnlp and getattr(hbnlp, name, None) is each):
                continue
            if name not in RESULTS:
                found[label] = each
            if inspect.isclass(each):
                found |= {f"{label}.{method}": function for method, function in _methods(each)}
    return {label: each for label, each in found.items() if label not in INNER and not LAWS.search(label)}


def _methods(owner):
    for name in sorted(vars(owner).keys() | {key for base in owner.__mro__[:-1] for key in vars(base)}):
        function = inspect.getattr_static(owner, name)
        bound = isinstance(function, classmethod)
        function = function.__func__ if bound else function
        inside = inspect.isfunction(function) and function.__module__.startswith("hbnlp")
        if not name.startswith("_") and inside and len(inspect.signature(function).parameters) > 1:
            yield name, getattr(owner, name) if bound else function


def parameters_of(function):
    """Return the parameters of a callable that can be wrong, with their annotations."""
    named = inspect.signature(function).parameters.values()
    kept = [each for each in named if each.name != "self" and each.kind is not each.VAR_KEYWORD]
    return {each.name: str(each.annotation) for each in kept}


def excused(annotation, wrong, name):
    """Return whether an annotation lets a wrong kind through; many is only right for what takes no memory."""
    if wrong == "huge" and "int" in annotation and name in HARMLESS:
        return True
    return any(wrong in kinds for word, kinds in RIGHT_FOR.items() if re.search(rf"\w*{word}\w*", annotation))


class Hang(BaseException):
    """A call that takes longer than an error may."""


def trial(function, arguments, name, value):
    """Return "accepted", "refused", or what is wrong with the error, of one call with one argument replaced."""
    arguments = dict(arguments) | {name: value}
    positional = [arguments.pop("self")] if "self" in arguments else []
    named = inspect.signature(function).parameters.values()
    positional += [arguments.pop(each.name) for each in named if each.kind is each.VAR_POSITIONAL]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            function(*positional, **arguments)
    except hbnlp.SaveError as error:  # all that was to be written was accepted, only its folder is missing
        return (_fault(error, name) or "refused") if name == "path" else "accepted"
    except (TypeError, ValueError, KeyError, hbnlp.HbnlpError, dns.FlowError) as error:
        return _fault(error, name) or "refused"
    except OSError:
        pass
    except Exception as error:  # noqa: BLE001 - whatever else comes is what is looked for
        return f"raises {type(error).__name__}: {error}"
    return "accepted"


def _fault(error, name):
    frames = error.__traceback__
    while frames.tb_next is not None:
        frames = frames.tb_next
    file, line = frames.tb_frame.f_code.co_filename, frames.tb_lineno
    here = f"{file.removeprefix(str(ROOT))}:{line}"
    if ROOT not in Path(file).parents or not linecache.getline(file, line).lstrip().startswith("raise"):
        return f"raw {type(error).__name__} at {here}: {error}"
    if not re.search(rf"\b{name}\b|Courant|'x' (holds|is)|the symbol s", str(error)) and not re.search(
        r"unknown (parameter|output)", str(error)
    ):
        return f"does not name {name} at {here}: {error}"
    return None


@functools.cache
def world():
    """Return what right calls are made of, small and quick."""
    w = types.SimpleNamespace()
    w.system = systems.duffing()
    w.problem = hbnlp.HarmonicBalance(w.system, 1)
    w.solution = hbnlp.solve(w.problem, at={"omega": 0.8})
    w.found = hbnlp.find_all(w.problem, at={"omega": 0.8}, method=hbnlp.Search(n_starts=0, largest_load=0.0))
    w.branch = hbnlp.trace(w.problem, "omega", (0.9, 1.4), stability=None)
    w.floquet = hbnlp.floquet(w.solution)
    w.fold = w.branch.folds[0]
    w.diagram = hbnlp.explore(w.problem, "omega", (0.9, 1.4), depth=0)
    w.study = hbnlp.study(functools.partial(hbnlp.solve, w.problem), over={"omega": [0.7, 0.8]})
    w.curve = hbnlp.follow(w.fold, "force", span=(0.17, 0.19))
    w.sweep = hbnlp.sweep(w.problem, "omega", [0.7, 0.8])
    w.time_sweep = hbnlp.sweep(w.system, "omega", [0.7, 0.71], periodic_tol=1e-3)
    w.response = hbnlp.integrate(w.system, at={"omega": 0.7}, periodic_tol=1e-3)
    chain = hbnlp.HarmonicBalance(systems.chain(2), 1)
    w.chain = hbnlp.solve(chain, at={"omega": 0.3})
    w.rom = aero.thin_airfoil(2)
    w.membrane = hbnlp.QuasiLinearMembrane(n_modes=2)
    w.wing = hbnlp.membrane_wing(w.membrane, w.rom)
    w.lifts = hbnlp.lift_response(w.wing, [0.5, 1.0], tensions=[1.0])
    omega = np.linspace(0.1, 2.0, 30)
    w.frequency_response = aero.FrequencyResponse(
        omega=omega, values=w.rom.transfer(1j * omega), static=w.rom.transfer(0.0).real, base_load=np.zeros(3)
    )
    w.fit = aero.identify(w.frequency_response, tolerance=0.05)
    w.variables = design.Variables({"force": (0.1, 0.3)})
    w.at_response = design.response_at(w.problem, w.variables, w.solution)
    w.program = design.Program(w.variables, [w.at_response], objective=w.variables["force"])
    w.identification = identification.Identification(
        w.variables, w.problem, [({"omega": 0.8}, w.solution), ({"omega": 0.7}, w.sweep.solution(0))], "x"
    )
    w.measurements = identification.Measurements([0.6, 0.7, 0.8], [0.29, 0.37, 0.51])
    w.measured_fit = identification.identify(w.problem, w.variables, w.measurements, "x", start={"force": 0.18})
    w.identified = w.measured_fit.identified
    w.grid = dns.Grid.around_plate(cells=8, levels=1)
    w.steady = dns.Simulation(w.grid, dns.SharpPlate(n_modes=2)).state()
    w.simulation, w.running = (dns.Simulation(w.grid, dns.SharpPlate(n_modes=2)) for _ in range(2))
    w.history = w.simulation.run(0.1)
    membrane = dns.Membrane(w.membrane)
    w.coupled = dns.Simulation(w.grid, membrane, motion=dns.Motion.at_incidence(5.0)).run(0.2)
    w.snapshot = dns.Snapshot.of(w.simulation)
    return w


@functools.cache
def examples():
    """Return a right call of every public callable: its arguments by name, ``self`` among them."""
    w = world()
    point = {"omega": 0.8}
    records = {
        "Branch": w.branch,
        "FoldBranch": w.curve,
        "Sweep": w.sweep,
        "TimeSweep": w.time_sweep,
    }
    calls = {
        "Adaptive": {"rtol": 1e-8, "atol": 1e-10, "samples_per_period": 64, "stiff": False},
        "AeroROM": {
            "stiffness": w.rom.stiffness, "damping": w.rom.damping, "mass": w.rom.mass, "lag_state": w.rom.lag_state,
            "lag_input": w.rom.lag_input, "lag_output": w.rom.lag_output, "base_motion": w.rom.base_motion,
            "base_load": w.rom.base_load, "provenance": w.rom.provenance,
        },
        "AeroROM.from_statespace": {
            "system": w.rom.to_statespace(), "base_motion": np.zeros(4), "base_load": np.zeros(3), "provenance": None,
        },
        "AeroROM.load": {"path": "no such file"},
        "AeroROM.save": {"self": w.rom, "path": "no such folder/file"},
        "AeroROM.transfer": {"self": w.rom, "s": 1j},
        "AeroROM.truncated": {"self": w.rom, "n_modes": 1},
        "Autosave": {"path": "branch.npz", "seconds": 1.0},
        "Branch.at": {"self": w.branch, "value": 1.2},
        "Branch.of_kind": {"self": w.branch, "kind": "fold"},
        "Diagram.at": {"self": w.diagram, "value": 1.2},
        "Diagram.load": {"path": "no such file", "problem": None},
        "Diagram.march": {
            "self": w.diagram, "way": "up", "begin": 0.9, "branch": 0, "integrated": False, "max_periods": 2000,
        },
        "Diagram.plot": {"self": w.diagram, "output": "x", "ax": None, "harmonic": 1},
        "Diagram.save": {"self": w.diagram, "path": "no such folder/file"},
        "Diagram.to_netcdf": {"self": w.diagram, "path": "no such folder/file"},
        "Floquet": {"tol": 1e-6, "nodes": 8, "intervals": 8, "max_intervals": 64},
        "FoldBranch.of_kind": {"self": w.curve, "kind": "cusp"},
        "FoldBranch.plot": {"self": w.curve, "ax": None},
        "FoldEvent.of": {"kind": "cusp"},
        "HarmonicBalance": {
            "system": w.system, "n_harmonics": None, "tolerance": 0.1, "outputs": (), "most_harmonics": 3, "periods": 1,
            "n_samples": 8,
        },
        "HarmonicBalance.amplitude_squared": {"self": w.problem, "name": "x", "harmonic": 1},
        "HarmonicBalance.coefficients": {"self": w.problem, "dof": 0},
        "HarmonicBalance.output": {"self": w.problem, "name": "x"},
        "HarmonicBalance.symbol": {"self": w.problem, "name": "omega"},
        "HarmonicBalance.values": {"self": w.problem, "at": point},
        "HarmonicBalance.vector": {"self": w.problem, "coefficients": np.zeros((1, 3))},
        "HarmonicBalance.with_harmonics": {"self": w.problem, "n_harmonics": 2},
        "Ipopt": {"tol": 1e-10, "max_iterations": 50},
        "Kind.of": {"kind": "fold"},
        "Newton": {"tol": 1e-10, "max_iterations": 10},
        "PseudoArclength": {
            "step": 0.02, "min_step": 1e-8, "max_step": 0.2, "angle": 7.0, "max_points": 20, "newton": hbnlp.Newton(),
        },
        "Rootfinder": {"plugin": "newton", "tol": 1e-10, "max_iterations": 10},
        "RungeKutta4": {"steps_per_period": 256},
        "ExponentialRungeKutta4": {"steps_per_period": 256},
        "Search": {
            "n_starts": 1, "amplitudes": (0.1, 1.0), "n_deflated": 0, "largest_load": 0.0, "separation": 1e-5,
            "max_iterations": 5, "newton": hbnlp.Newton(),
        },
        "Solution.displacement": {"self": w.solution, "t": 0.0},
        "Solution.harmonics": {"self": w.solution, "output": "x"},
        "Solution.load": {"path": "no such file", "problem": None},
        "Solution.animate": {"self": w.solution, "path": "no such folder/film.gif"},
        "FloquetResult.to_netcdf": {"self": w.floquet, "path": "no such folder/file"},
        "TimeResponse.plot": {"self": w.response, "output": "x", "ax": None},
        "dns.History.to_netcdf": {"self": w.history, "path": "no such folder/file"},
        "Solution.plot": {"self": w.solution, "output": "x", "ax": None},
        "Solution.plot_harmonics": {"self": w.solution, "output": "x", "ax": None},
        "Solution.plot_phase": {"self": w.solution, "output": "x", "ax": None},
        "Solution.plot_shape": {"self": w.solution, "ax": None},
        "Solution.save": {"self": w.solution, "path": "no such folder/file"},
        "Solution.to_netcdf": {"self": w.solution, "path": "no such folder/file"},
        "Solution.signal": {"self": w.solution, "output": "x", "t": 0.0},
        "Solution.velocity": {"self": w.solution, "t": 0.0},
        "SolutionSet.load": {"path": "no such file", "problem": None},
        "SolutionSet.plot": {"self": w.found, "output": "x", "ax": None},
        "SolutionSet.save": {"self": w.found, "path": "no such folder/file"},
        "SolutionSet.to_netcdf": {"self": w.found, "path": "no such folder/file"},
        "Study.load": {"path": "no such folder", "problem": None},
        "Study.save": {"self": w.study, "path": "no such folder/study"},
        "Study.to_netcdf": {"self": w.study, "path": "no such folder/file", "extract": None},
        "Study.to_xarray": {"self": w.study, "extract": None},
        "Symmetry": {"matrix": [[-1.0]], "shift": np.pi, "name": "odd"},
        "ValidityLimits": {"camber": 0.1, "tension_error": 0.1, "beyond_band": 0.1, "incidence": 0.2},
        "Symmetry.identity": {"n_dof": 1},
        "System": {
            "mass": [[1.0]], "damping": [[0.1]], "stiffness": [[1.0]], "nonlinear_force": lambda q, v, tau, p: q**3,
            "forcing": lambda tau, p: p.force * ca.cos(tau), "parameters": {"force": 1.0},
            "outputs": {"x": lambda s: s.q[0]}, "lag_state": [[-1.0]], "lag_input": [[1.0]], "lag_output": [[1.0]],
            "motion": lambda tau, p: ca.sin(tau), "input_stiffness": [[1.0]], "input_damping": [[1.0]],
            "input_mass": [[1.0]], "lag_motion": [[1.0]], "symmetries": (), "angles": (), "labels": {"x": "x"},
            "units": {"x": "mm"}, "name": "system",
        },
        "System.linearisation": {"self": w.system, "at": None, "rest": None},
        "System.output_index": {"self": w.system, "name": "x"},
        "System.symmetries_at": {"self": w.system, "at": None},
        "TimeResponse.all_harmonics": {"self": w.response, "n_harmonics": 1},
        "TimeResponse.displacement_harmonics": {"self": w.response, "n_harmonics": 1},
        "TimeResponse.harmonics": {"self": w.response, "output": "x", "n_harmonics": 1},
        "TimeResponse.load": {"path": "no such file"},
        "TimeResponse.save": {"self": w.response, "path": "no such folder/file"},
        "TimeResponse.to_netcdf": {"self": w.response, "path": "no such folder/file"},
        "TimeResponse.signal": {"self": w.response, "output": "x"},
        "Tracer": {
            "subject": w.problem, "name": "omega", "span": (0.7, 0.8), "at": {"force": 0.18},
            "start": w.sweep.solution(0), "direction": 1, "stability": None, "method": None, "events": None,
            "resume": None,
        },
        "trace": {
            "subject": w.problem, "name": "omega", "span": (0.7, 0.71), "at": {"force": 0.18},
            "start": w.sweep.solution(0), "direction": 1, "stability": None, "method": None, "events": None,
            "callbacks": (), "resume": None,
        },
        "eigenvalues": {"system": w.system, "at": None, "rest": None},
        "explore": {
            "problem": w.problem, "name": "omega", "span": (0.7, 0.71), "at": {"force": 0.18},
            "start": w.sweep.solution(0), "depth": 0, "max_points": 20, "search_at": None,
            "search": hbnlp.Search(n_starts=0, largest_load=0.0), "known": (), "beside_stable": False,
            "stability": None, "method": None, "events": None, "executor": None, "callbacks": (), "resume": None,
        },
        "find_all": {
            "problem": w.problem, "at": point, "method": hbnlp.Search(n_starts=0, largest_load=0.0), "rng": None,
            "known": (), "executor": None, "callbacks": (),
        },
        "floquet": {"solution": w.solution, "method": None},
        "follow": {
            "point": w.fold, "name": "force", "span": (0.179, 0.181), "limits": (1.0, 1.5), "event": None,
            "method": None, "callbacks": (),
        },
        "integrate": {
            "system": w.system, "at": point, "method": hbnlp.RungeKutta4(), "start": None, "periods": 1,
            "max_periods": 2000, "periodic_tol": 1e-2, "throw": True, "callbacks": (),
        },
        "lift_response": {"wing": w.wing, "omega": [0.5], "tensions": [1.0], "at": None},
        "linear_wing": {"wing": w.wing, "at": None, "rest": None},
        "locate_peak": {
            "problem": w.problem, "output": "x", "name": "omega", "near": w.branch.solution(30), "harmonic": 1,
            "method": None, "bracket": None, "index": 0,
        },
        "membrane_wing": {
            "membrane": w.membrane, "rom": w.rom, "pitch_axis": 0.0, "motion": None, "parameters": {"mass_ratio": 0.5},
            "limits": None,
        },
        "peaks": {"branch": w.branch, "output": "x", "harmonic": 1, "problem": None},
        "relation": {"a": w.solution, "b": w.solution, "tol": 1e-6},
        "same_motion": {"a": w.solution, "b": w.solution, "tol": 1e-6},
        "solve": {"problem": w.problem, "at": point, "start": None, "method": None, "throw": True},
        "stability_limits": {
            "system": w.system, "name": "damping_ratio", "span": (0.1, 0.2), "at": None, "rest": None, "n_points": 3,
        },
        "sweep": {
            "subject": w.system, "name": "omega", "values": [0.8], "at": {"force": 0.18}, "method": None, "start": None,
            "callbacks": (), "n_harmonics": 1, "periods": 1, "max_periods": 2000, "periodic_tol": 1e-2,
            "find_jumps": False,
        },
        "study": {
            "task": functools.partial(hbnlp.solve, w.problem), "over": [point], "executor": None, "folder": None,
            "callbacks": (),
        },
        "switch_branch": {"point": w.fold, "step": 0.02},
        "truncation_error": {"solution": w.solution},
        "aero.FrequencyResponse": {
            "omega": w.frequency_response.omega, "values": w.frequency_response.values,
            "static": w.frequency_response.static, "base_load": np.zeros(3), "provenance": {},
        },
        "aero.FrequencyResponse.band": {"self": w.frequency_response, "lowest": 0.5, "highest": 1.0},
        "aero.FrequencyResponse.column_errors": {"self": w.frequency_response, "other": w.frequency_response.values},
        "aero.FrequencyResponse.from_csv": {"path": "no such file", "base_load": None, "provenance": None},
        "aero.FrequencyResponse.load": {"path": "no such file"},
        "aero.FrequencyResponse.save": {"self": w.frequency_response, "path": "no such folder/file"},
        "aero.FrequencyResponse.to_netcdf": {"self": w.frequency_response, "path": "no such folder/file"},
        "aero.FrequencyResponse.to_csv": {"self": w.frequency_response, "path": "no such folder/file"},
        "aero.FrequencyResponse.truncated": {"self": w.frequency_response, "n_modes": 1},
        "aero.Provenance": {"source": "", "reynolds": 100.0, "incidence": 0.0, "band": (0.1, 1.0), "fit_error": 0.1},
        "aero.balanced_truncation": {"rom": w.rom, "n_lags": 1},
        "aero.flat_plate_re100": {"n_modes": 1, "full": False},
        "aero.flat_plate_re100_response": {},
        "aero.identify": {
            "response": w.frequency_response, "tolerance": 0.05, "band": (0.1, 2.0), "n_lags": 2, "damping": None,
            "most_poles": 6, "least_damping": 1e-6,
        },
        "aero.realise": {
            "time": 0.1 * np.arange(40), "loads": np.exp(-0.1 * np.arange(40))[:, None, None] * np.ones((40, 3, 4)),
            "n_lags": 1, "mass": np.zeros((3, 4)), "stiffness": None, "damping": None, "provenance": None,
        },
        "aero.reduce_to_band": {
            "rom": w.fit.rom, "response": w.frequency_response, "n_lags": 2, "sweeps": 1, "known": (),
        },
        "aero.theodorsen_transfer": {"s": 1j, "n_modes": 2},
        "aero.thin_airfoil": {"n_modes": 2},
        "design.Program": {
            "variables": w.variables, "responses": [w.at_response], "objective": w.variables["force"], "bounds": None,
            "data": None, "method": None, "expand": True,
        },
        "design.Program.solve": {
            "self": w.program, "start": {"force": 0.2}, "near": None, "data": (), "throw": True,
        },
        "design.Response.symbol": {"self": w.at_response, "name": "omega"},
        "design.Variables": {"bounds": {"force": (0.1, 0.2)}},
        "design.fold_at": {"problem": w.problem, "variables": w.variables, "fold": w.fold, "name": "omega"},
        "design.response_at": {"problem": w.problem, "variables": w.variables, "start": w.solution, "at": None},
        "identification.Identification": {
            "variables": w.variables, "problem": w.problem, "points": [({"omega": 0.8}, w.solution)], "output": "x",
            "harmonic": 1,
        },
        "identification.Identification.fit": {
            "self": w.identification, "measured": [0.4, 0.3], "start": {"force": 0.2}, "near": None, "weights": None,
            "noise": 0.01,
        },
        "describing_function": {"force": lambda q, v: q**3, "amplitude": [0.5, 1.0], "bias": 0.1, "omega": 1.0},
        "identification.Identified.confidence": {"self": w.identified, "level": 0.9},
        "identification.MeasuredFit.confidence": {"self": w.measured_fit, "level": 0.9},
        "identification.Measurements": {
            "omega": [0.7, 0.8], "amplitude": [0.3, 0.4], "way": ["up", ""], "lines": [2, 3],
        },
        "identification.Measurements.from_csv": {
            "path": "no such file", "omega": "omega", "amplitude": "amplitude", "way": None, "omega_unit": 1.0,
            "amplitude_unit": 1.0,
        },
        "identification.Measurements.named": {"self": w.measurements, "index": 0},
        "identification.identify": {
            "problem": w.problem, "variables": w.variables, "measurements": w.measurements, "output": "x",
            "start": {"force": 0.2}, "harmonic": 1, "at": None, "weights": np.ones(len(w.measurements)), "noise": 0.01,
            "threshold": 4.0, "span": (0.5, 1.5), "executor": None,
        },
        "systems.chain": {"n_masses": 2, "damping": 0.1, "cubic": 1.0, "force": 1.0},
        "systems.duffing": {"damping_ratio": 0.1, "cubic": 1.0, "force": 1.0},
        "systems.tuned_absorber": dict.fromkeys(
            ("force", "mass_ratio", "damping", "absorber_stiffness", "absorber_damping", "absorber_cubic"), 0.1
        ),
        "dns.Checkpoint": {"path": "state.npz", "every": 10},
        "dns.Grid": {"spacing": 0.1, "shape": (20, 20), "corner": (-0.5, -1.0), "levels": 1},
        "dns.Grid.around_plate": {"cells": 8, "ahead": 1.0, "behind": 1.0, "above": 1.05, "levels": 1},
        "dns.Grid.box": {"spacing": 0.1, "x": (-1.0, 2.0), "y": (-1.0, 1.0), "levels": 1},
        "dns.History.plot": {"self": w.history, "ax": None},
        "dns.Membrane": {"structure": w.membrane, "deflection": np.zeros(2), "rate": np.zeros(2)},
        "dns.Motion": {"pitch": dns.Motion().pitch, "heave": dns.Motion().heave},
        "dns.Motion.at_incidence": {"degrees": 2.0},
        "dns.Motion.sinusoidal": {"omega": 1.0, "pitch": 0.1, "heave": 0.1, "mean_pitch": 0.0, "axis": 0.0},
        "dns.MovingPoints": {"motion": lambda _: np.zeros((2, 2, 2)), "reach": ((0.0, 1.0),) * 2, "closed": False},
        "dns.Points": {"positions": np.array([[0.0, 0.0], [0.1, 0.0]]), "closed": False},
        "dns.SharpPlate": {"deflection": None, "n_modes": 2},
        "dns.SharpPlate.oscillating": {"omega": 1.0, "amplitudes": np.zeros(2)},
        "dns.Simulation": {
            "grid": w.grid, "body": dns.SharpPlate(n_modes=2), "reynolds": 100.0, "dt": None, "motion": None,
            "stream": 1.0,
        },
        "dns.Simulation.run": {"self": w.running, "until": 0.1, "callback": None},
        "dns.Snapshot.plot": {"self": w.snapshot, "ax": None, "limit": 5.0},
        "dns.Snapshots": {"every": 1.0, "taken": []},
        "dns.circle": {"spacing": 0.05, "diameter": 1.0, "centre": (0.0, 0.0), "ratio": 1.5, "retraction": 0.3},
        "dns.harmonics": {"time": 0.1 * np.arange(100), "values": np.ones(100), "omegas": [1.0, 2.0]},
        "dns.linear_response": {
            "grid": w.grid, "channel": "pitch", "multiples": [1], "base": 20.0, "steady": w.steady, "reynolds": 100.0,
            "dt": None, "n_modes": 2, "amplitude": 1e-5, "periods": 1.5, "callback": None,
        },
        "dns.load_history": {"path": "no such file"},
        "dns.load_state": {"simulation": w.simulation, "path": "no such file"},
        "dns.neglected_inertia": {"history": w.coupled, "motion": dns.Motion(), "mass_ratio": 1.0},
        "dns.save_history": {"history": w.history, "path": "no such folder/file"},
        "dns.save_state": {"simulation": w.simulation, "path": "no such folder/file"},
        "dns.step_response": {
            "grid": w.grid, "channel": "pitch", "duration": 0.1, "steady": w.steady, "reynolds": 100.0, "dt": None,
            "n_modes": 2, "amplitude": 1e-6, "callback": None,
        },
        "dns.together": {"callbacks": len},
        "plot.animate": {
            "snapshots": [w.snapshot], "path": "no such folder/file.gif", "frames_per_second": 15, "limit": 5.0,
            "x": (0.0, 1.0), "y": (0.0, 1.0),
        },
        "plot.animate_solution": {
            "solution": w.solution, "path": "no such folder/film.gif", "output": "x", "modes": None, "in_space": False,
            "n_frames": 2, "frames_per_second": 20,
        },
        "plot.plot_harmonics": {"solution": w.solution, "output": "x", "logarithmic": False, "ax": None},
        "plot.plot_phase": {"solution": w.solution, "output": "x", "ax": None},
        "plot.plot_shape": {
            "solution": w.solution, "modes": None, "in_space": False, "n_shapes": 3, "ax": None,
        },
        "plot.plot_signal": {"solution": w.solution, "output": "x", "ax": None},
        "plot.plot_branch": {
            "branch": w.branch, "output": "x", "ax": None, "harmonic": 1, "per": None, "decibels": False,
            "special": True, "codes": False, "label": None, "color": None, "validity": None,
        },
        "plot.plot_diagram": {
            "diagram": w.diagram, "output": "x", "ax": None, "harmonic": 1, "per": None, "decibels": False,
            "special": True, "codes": False, "validity": None,
        },
        "plot.plot_fold_curve": {"curve": w.curve, "ax": None, "label": None, "special": True},
        "plot.plot_lift_response": {"response": w.lifts, "ax": None},
        "plot.plot_loads": {"history": w.history, "ax": None},
        "plot.plot_clicked": {
            "branch": w.branch, "output": "x", "ax": None, "draw": None, "harmonic": 1, "per": None, "decibels": False,
        },
        "plot.plot_response": {"response": w.response, "output": "x", "ax": None},
        "plot.plot_measured_fit": {"fit": w.measured_fit},
        "plot.plot_rational_fit": {"fit": w.fit},
        "plot.plot_solutions": {"found": w.found, "output": "x", "ax": None},
        "plot.plot_sweep": {
            "sweep": w.sweep, "output": "x", "ax": None, "harmonic": 1, "per": None, "decibels": False, "label": None,
            "jumps": True,
        },
        "plot.plot_vorticity": {
            "snapshot": w.snapshot, "ax": None, "limit": 5.0, "levels": 1, "x": (0.0, 1.0), "y": (0.0, 1.0),
            "bar": True,
        },
    }  # fmt: skip
    for membrane in ("LinearMembrane", "QuasiLinearMembrane", "NonlinearMembrane"):
        calls[membrane] = {"mass_ratio": 0.5, "stiffness": 1.0, "prestrain": 0.1, "n_modes": 2}
    calls["NonlinearMembrane"] |= {"n_nodes": 16}
    for name, record in records.items():
        load = {"path": "no such file"} | ({"system": None} if name == "TimeSweep" else {"problem": None})
        own = {
            "harmonics": {"output": "x"},
            "load": load,
            "plot": {"output": "x", "ax": None, "harmonic": 1},
            "save": {"path": "no such folder/file"},
            "to_netcdf": {"path": "no such folder/file"},
            "solution": {"index": 0},
            "values": {"name": "omega"},
        }
        for method, arguments in own.items():
            itself = {} if method == "load" else {"self": record}
            calls.setdefault(f"{name}.{method}", itself | arguments)
    del calls["FoldBranch.harmonics"]
    return calls
