"""Linear response of the loads on a moving plate by finite elements about the steady flow (extra ``hbnlp[flow]``)."""

from hbnlp.aero.linear_flow.base_flow import BaseFlow, steady_flow
from hbnlp.aero.linear_flow.campaign import Case, UnsteadyFlowError, run_campaign
from hbnlp.aero.linear_flow.mesh import MeshSettings, half_mesh, slit_mesh
from hbnlp.aero.linear_flow.response import LinearResponse

__all__ = [
    "BaseFlow",
    "Case",
    "LinearResponse",
    "MeshSettings",
    "UnsteadyFlowError",
    "half_mesh",
    "run_campaign",
    "slit_mesh",
    "steady_flow",
]
