"""All of matplotlib: every figure of the package, drawn from results whose types it knows by name only."""

from hbnlp.plot.aero import plot_lift_response, plot_rational_fit
from hbnlp.plot.branches import EVENT_MARKERS, MARKERS, plot_branch, plot_diagram, plot_fold_curve, plot_sweep
from hbnlp.plot.flow import animate, plot_loads, plot_vorticity
from hbnlp.plot.motions import plot_solutions

__all__ = [
    "EVENT_MARKERS",
    "MARKERS",
    "animate",
    "plot_branch",
    "plot_diagram",
    "plot_fold_curve",
    "plot_lift_response",
    "plot_loads",
    "plot_rational_fit",
    "plot_solutions",
    "plot_sweep",
    "plot_vorticity",
]
