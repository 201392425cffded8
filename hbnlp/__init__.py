"""Nonlinear frequency response of membrane wings and other forced oscillators.

Harmonic balance as a CasADi nonlinear program, traced through its folds with Floquet stability.
"""

from importlib.metadata import version
from typing import Any

from hbnlp import aero, design, identification, systems
from hbnlp.aero import AeroROM
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.extrema import locate_peak, peaks
from hbnlp.branches.fold_curves import FoldBranch
from hbnlp.branches.following import follow
from hbnlp.branches.special_points import SpecialPoint
from hbnlp.branches.switching import switch_branch
from hbnlp.branches.tracer import Tracer
from hbnlp.branches.tracing import trace
from hbnlp.continuation.arclength import PseudoArclength
from hbnlp.continuation.newton import Newton
from hbnlp.core.callbacks import Autosave, Progress, ProgressBar, StopTracing
from hbnlp.core.errors import (
    AliasingWarning,
    CallbackError,
    ConvergenceError,
    CornerError,
    HbnlpError,
    LinearInstabilityWarning,
    LoadError,
    NonFiniteError,
    OutsideBandWarning,
    SamplingError,
    SaveError,
    TaskError,
    ValidityWarning,
)
from hbnlp.core.kinds import End, FoldEvent, Kind, Status
from hbnlp.core.old_names import announce_old_imports, old_names
from hbnlp.core.renamed import renamed_name
from hbnlp.diagrams.diagram import Diagram
from hbnlp.diagrams.exploring import explore
from hbnlp.integration.cvodes import Adaptive
from hbnlp.integration.exponential import ExponentialRungeKutta4
from hbnlp.integration.response import TimeResponse
from hbnlp.integration.runge_kutta import RungeKutta4
from hbnlp.integration.settling import integrate
from hbnlp.solutions.identity import relation, same_motion
from hbnlp.solutions.ipopt import Ipopt
from hbnlp.solutions.rootfinder import Rootfinder
from hbnlp.solutions.search import Search, find_all
from hbnlp.solutions.solution import Solution
from hbnlp.solutions.solution_set import SolutionSet
from hbnlp.solutions.solving import solve
from hbnlp.solutions.truncation import truncation_error
from hbnlp.stability.multipliers import floquet
from hbnlp.stability.result import Floquet, FloquetResult
from hbnlp.studies.outcomes import Failure
from hbnlp.studies.record import Study
from hbnlp.studies.running import study
from hbnlp.sweeps.records import Sweep, TimeSweep
from hbnlp.sweeps.sweeping import sweep
from hbnlp.systems.describing import describing_function
from hbnlp.systems.linear_stability import eigenvalues, stability_limits
from hbnlp.systems.symmetry import Symmetry
from hbnlp.systems.system import System
from hbnlp.wing.coupling import membrane_wing
from hbnlp.wing.lift import lift_response
from hbnlp.wing.membrane import LinearMembrane, NonlinearMembrane, QuasiLinearMembrane
from hbnlp.wing.statespace import linear_wing
from hbnlp.wing.validity import ValidityLimits

__version__ = version("hbnlp")

announce_old_imports()

__all__ = [
    "Adaptive",
    "AeroROM",
    "AliasingWarning",
    "Autosave",
    "Branch",
    "CallbackError",
    "ConvergenceError",
    "CornerError",
    "Diagram",
    "End",
    "ExponentialRungeKutta4",
    "Failure",
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
    "LoadError",
    "Newton",
    "NonFiniteError",
    "NonlinearMembrane",
    "OutsideBandWarning",
    "Progress",
    "ProgressBar",
    "PseudoArclength",
    "QuasiLinearMembrane",
    "Rootfinder",
    "RungeKutta4",
    "SamplingError",
    "SaveError",
    "Search",
    "Solution",
    "SolutionSet",
    "SpecialPoint",
    "Status",
    "StopTracing",
    "Study",
    "Sweep",
    "Symmetry",
    "System",
    "TaskError",
    "TimeResponse",
    "TimeSweep",
    "Tracer",
    "ValidityLimits",
    "ValidityWarning",
    "aero",
    "describing_function",
    "design",
    "eigenvalues",
    "explore",
    "find_all",
    "floquet",
    "follow",
    "identification",
    "integrate",
    "lift_response",
    "linear_wing",
    "locate_peak",
    "membrane_wing",
    "peaks",
    "relation",
    "same_motion",
    "solve",
    "stability_limits",
    "study",
    "sweep",
    "switch_branch",
    "systems",
    "trace",
    "truncation_error",
]


def __getattr__(name: str) -> Any:
    raise renamed_name(__name__, name, old_names(__name__))
