"""What Sphinx-Gallery makes of an example: the place of its page, its one picture, and an error of each warning.

`sphinx_gallery_conf` in conf.py names these functions instead of passing them: the worker processes that run the
examples import this module and never read conf.py.
"""

import multiprocessing
import warnings
from pathlib import Path
from typing import Any

from matplotlib import pyplot as plt
from sphinx.errors import ConfigError, ExtensionError
from sphinx_gallery.scrapers import matplotlib_scraper

from hbnlp import ValidityWarning

# The order in which a reader meets the examples of a folder: the paper's figures by number, then the easiest first.
READING_ORDER = {
    "paper": (
        "figure_2_linear_lift",
        "small_amplitudes",
        "figure_3_quasi_linear",
        "figure_4_hysteresis",
        "figure_5_harmonics",
        "hysteresis_map",
        "first_tongue",
        "all_solutions",
        "direct_integration",
        "modes",
    ),
    "wing": (
        "own_wing",
        "linear_lift_response",
        "membrane_wing_inviscid",
        "wing_in_motion",
        "time_integration_vs_harmonic_balance",
        "design_prestrain",
        "identify_membrane",
        "identify_from_table",
        "rom_from_data",
        "linear_control",
    ),
    "oscillators": (
        "duffing_hysteresis",
        "own_equations",
        "absorber_isola",
        "mass_chain",
        "study_of_dampings",
        "choose_harmonics",
    ),
    "flow": ("dns_cylinder", "coupled_dns_vs_harmonic_balance"),
}


def reading_order(script: str) -> int:
    """Return the place of a script among the examples."""
    name, order = Path(script).stem, [name for names in READING_ORDER.values() for name in names]
    if name not in order:
        raise ConfigError(f"the example {name} has no place on the gallery page: name it in READING_ORDER, {__file__}")
    return order.index(name)


def warnings_are_errors(gallery_conf: dict[str, Any], script: str) -> None:  # noqa: ARG001  Sphinx-Gallery's signature
    """Make each warning of the example that follows an error, as it is one in a test."""
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", ValidityWarning)  # the paper's wing is beyond its limits by far: its page says so


def processes_are_spawned(gallery_conf: dict[str, Any], script: str) -> None:  # noqa: ARG001  Sphinx-Gallery's signature
    """Let the example that follows start processes: joblib's way to start the one it runs in is not known to others."""
    multiprocessing.set_start_method("spawn", force=True)


def whole_figure(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Return the picture of a block that draws the page's figure, and refuse a figure that is not finished.

    Sphinx-Gallery shows, and closes, what is open at the end of each block. A figure that is made in one block and
    drawn in a later one would be on the page with empty axes, and what is drawn later on no page at all.

    Parameters
    ----------
    block : sphinx_gallery.py_source_parser.Block
        The code that has just run, between two lines ``# %%``.
    block_vars, gallery_conf : dict
        What Sphinx-Gallery knows of the example, and its configuration.

    Returns
    -------
    str
        reStructuredText of the picture; empty without a figure.

    Raises
    ------
    sphinx.errors.ExtensionError
        If an open figure has axes without data, if it is not saved in the same block, or if none is open there.
    """
    figures = [plt.figure(number) for number in plt.get_fignums()]
    where = f"{Path(block_vars['src_file']).name}, the block from line {block.lineno} on"
    expected = int(".savefig(" in block.content)
    if len(figures) != expected:
        raise ExtensionError(
            f"{where}: {len(figures)} figures are open at its end, expected {expected}: "
            "make, draw and save the one figure of an example in its last block"
        )
    for figure in figures:
        empty = [f"{k} {ax.get_title()!r}" for k, ax in enumerate(figure.axes) if not ax.has_data()]
        if empty or not figure.axes:
            raise ExtensionError(
                f"{where}: the figure has {len(figure.axes)} axes, without data: {', '.join(empty) or 'all'}; "
                "draw all of it in the block that makes it"
            )
    return str(matplotlib_scraper(block, block_vars, gallery_conf))
