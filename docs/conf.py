"""Sphinx configuration: sphinx-build -W docs docs/_build/html."""

import importlib.metadata
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # for gallery_pages.py and checked_pages.py

os.environ.setdefault("TQDM_DISABLE", "1")  # progress bars are for terminals, not for pages
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")  # as in the tests: the examples themselves run side by side

project = "hbnlp"
author = "The hbnlp developers"
copyright = author
release = importlib.metadata.version("hbnlp")
version = release

extensions = [
    "checked_pages",
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx_gallery.gen_gallery",
    "sphinx-mathjax-offline",  # formulas are set by files of the pages themselves: no network is asked
]
templates_path = ["_templates"]
exclude_patterns = ["_build"]

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_title = f"hbnlp {release}"

myst_enable_extensions = ["amsmath", "dollarmath"]
myst_heading_anchors = 3

# API pages: one for each name in api.rst
autosummary_generate = True
autodoc_typehints = "none"  # numpydoc's Parameters say type and shape
numpydoc_show_class_members = False  # the class template lists them
# A type in a docstring is a link to its page, if it has one here: not to pages of Python and numpy.
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "subsection_order": [f"../examples/{folder}" for folder in ("paper", "wing", "oscillators", "flow")],
    "within_subsection_order": "gallery_pages.reading_order",
    "filename_pattern": r"\.py$",  # every example is run, and nowhere else: this is its test
    "abort_on_example_error": True,
    "reset_modules": ("matplotlib", "gallery_pages.warnings_are_errors", "gallery_pages.processes_are_spawned"),
    "image_scrapers": ("gallery_pages.whole_figure",),
    # always in processes of their own, so that their warnings' filter is not Sphinx's
    "parallel": min(4, max(2, os.cpu_count() or 2)),
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "remove_config_comments": True,
    "min_reported_time": 1e9,
    "write_computation_times": False,  # their tables ask the network
}


def setup(app):
    """Set what takes the packages that make the pages: tests read the rest of this file without them."""
    from numpydoc.xref import DEFAULT_LINKS

    import hbnlp

    own = {name: f"hbnlp.{name}" for name in hbnlp.__all__}
    app.config.numpydoc_xref_aliases = {word: word for word in DEFAULT_LINKS} | own
