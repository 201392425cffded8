"""Nonlinear frequency response of membrane wings and other forced oscillators.

Harmonic balance as a CasADi nonlinear program, traced through its folds with Floquet stability.
"""

from importlib.metadata import version

from hbnlp import aero, design, identification, systems
from hbnlp.aero import AeroROM
from hbnlp.aeroelastic import lift_response
from hbnlp.balance import HarmonicBalance
from hbnlp.branch import Branch, End, Kind, SpecialPoint, load_branch
from hbnlp.callbacks import Autosave, Progress, ProgressBar, StopTracing
from hbnlp.continuation import PseudoArclength
from hbnlp.errors import (
    ConvergenceError,
    HbnlpError,
    LinearInstabilityWarning,
    NonFiniteError,
    OutsideBandWarning,
    SaveError,
    TaskError,
)
from hbnlp.foldcurves import FoldBranch, FoldEvent, fold_curve
from hbnlp.integrators import Adaptive, RungeKutta4
from hbnlp.linear_stability import eigenvalues, stability_limits
from hbnlp.membrane import LinearMembrane, NonlinearMembrane, QuasiLinearMembrane
from hbnlp.newton import Newton
from hbnlp.newtonmarch import Sweep
from hbnlp.peaks import locate_peak, peaks
from hbnlp.resolution import ResolvedBranch, resolve_harmonics
from hbnlp.search import Search, find_all
from hbnlp.solution import Solution, Status
from hbnlp.solve import Ipopt, Rootfinder, solve
from hbnlp.stability import Floquet, FloquetResult, floquet
from hbnlp.sweep import sweep
from hbnlp.switching import switch_branch
from hbnlp.system import System
from hbnlp.timemarch import integrate
from hbnlp.timeresponse import TimeResponse
from hbnlp.timesweep import TimeSweep
from hbnlp.trace import trace
from hbnlp.tracer import Tracer
from hbnlp.truncation import truncation_error
from hbnlp.wing import membrane_wing

__version__ = version("hbnlp")

__all__ = [
    "Adaptive",
    "AeroROM",
    "Autosave",
    "Branch",
    "ConvergenceError",
    "End",
    "Floquet",
    "FloquetResult",
    "FoldBranch",
    "FoldEvent",
    "HarmonicBalance",
    "HbnlpError",
    "Ipopt",
    "Kind",
    "LinearInstabilityWarning",
    "LinearMembrane",
    "Newton",
    "NonFiniteError",
    "NonlinearMembrane",
    "OutsideBandWarning",
    "Progress",
    "ProgressBar",
    "PseudoArclength",
    "QuasiLinearMembrane",
    "ResolvedBranch",
    "Rootfinder",
    "RungeKutta4",
    "SaveError",
    "Search",
    "Solution",
    "SpecialPoint",
    "Status",
    "StopTracing",
    "Sweep",
    "System",
    "TaskError",
    "TimeResponse",
    "TimeSweep",
    "Tracer",
    "aero",
    "design",
    "eigenvalues",
    "find_all",
    "floquet",
    "fold_curve",
    "identification",
    "integrate",
    "lift_response",
    "load_branch",
    "locate_peak",
    "membrane_wing",
    "peaks",
    "resolve_harmonics",
    "solve",
    "stability_limits",
    "sweep",
    "switch_branch",
    "systems",
    "trace",
    "truncation_error",
]
