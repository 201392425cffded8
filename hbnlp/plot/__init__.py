"""All of matplotlib: every figure of the package, drawn from results whose types it knows by name only."""

from typing import Any

from hbnlp.core.old_names import old_names
from hbnlp.core.renamed import renamed_name
from hbnlp.plot.aero import plot_lift_response, plot_rational_fit
from hbnlp.plot.branches import EVENT_MARKERS, MARKERS, plot_branch, plot_diagram, plot_fold_curve, plot_sweep
from hbnlp.plot.clicked import plot_clicked
from hbnlp.plot.flow import animate, plot_loads, plot_vorticity
from hbnlp.plot.measured import plot_measured_fit
from hbnlp.plot.motions import plot_harmonics, plot_phase, plot_response, plot_signal, plot_solutions
from hbnlp.plot.shapes import animate_solution, plot_shape

__all__ = [
    "EVENT_MARKERS",
    "MARKERS",
    "animate",
    "animate_solution",
    "plot_branch",
    "plot_clicked",
    "plot_diagram",
    "plot_fold_curve",
    "plot_harmonics",
    "plot_lift_response",
    "plot_loads",
    "plot_measured_fit",
    "plot_phase",
    "plot_rational_fit",
    "plot_response",
    "plot_shape",
    "plot_signal",
    "plot_solutions",
    "plot_sweep",
    "plot_vorticity",
]


def __getattr__(name: str) -> Any:
    raise renamed_name(__name__, name, old_names(__name__))
