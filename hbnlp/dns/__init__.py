"""Incompressible flow past thin and closed bodies and membranes, by an immersed-boundary projection method.

>>> from hbnlp import dns
>>> flow = dns.Simulation(
...     dns.Grid.around_plate(cells=25, levels=4), dns.SharpPlate(), motion=dns.Motion.at_incidence(2.0)
... )
>>> history = flow.run(0.1)
>>> history.lift.shape
(9,)
"""

from typing import Any

from hbnlp.core.old_names import old_names
from hbnlp.core.renamed import renamed_name
from hbnlp.dns.bodies import MovingPoints, Points, SharpPlate, circle
from hbnlp.dns.errors import FlowError
from hbnlp.dns.flow import Simulation
from hbnlp.dns.grid import Grid
from hbnlp.dns.history import History
from hbnlp.dns.loads import neglected_inertia
from hbnlp.dns.membrane import Membrane, Structure
from hbnlp.dns.motion import Motion
from hbnlp.dns.observers import Checkpoint, ProgressBar, Snapshot, Snapshots, together
from hbnlp.dns.response import LinearResponse, StepResponse, harmonics, linear_response, step_response
from hbnlp.dns.storage import load_history, load_state, save_history, save_state

__all__ = [
    "Checkpoint",
    "FlowError",
    "Grid",
    "History",
    "LinearResponse",
    "Membrane",
    "Motion",
    "MovingPoints",
    "Points",
    "ProgressBar",
    "SharpPlate",
    "Simulation",
    "Snapshot",
    "Snapshots",
    "StepResponse",
    "Structure",
    "circle",
    "harmonics",
    "linear_response",
    "load_history",
    "load_state",
    "neglected_inertia",
    "save_history",
    "save_state",
    "step_response",
    "together",
]


def __getattr__(name: str) -> Any:
    raise renamed_name(__name__, name, old_names(__name__))
