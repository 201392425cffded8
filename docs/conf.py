"""Sphinx configuration: sphinx-build -W docs docs/_build/html."""

import importlib.metadata
import os

os.environ.setdefault("TQDM_DISABLE", "1")  # progress bars are for terminals, not for pages

project = "hbnlp"
author = "The hbnlp developers"
copyright = author
release = importlib.metadata.version("hbnlp")
version = release

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx_gallery.gen_gallery",
]
templates_path = ["_templates"]
exclude_patterns = ["_build"]

html_theme = "furo"
html_static_path = ["_static"]
html_title = f"hbnlp {release}"

myst_enable_extensions = ["amsmath", "dollarmath"]
myst_heading_anchors = 3

# API pages: one for each name in api.rst
autosummary_generate = True
autodoc_typehints = "none"  # numpydoc's Parameters say type and shape
numpydoc_show_class_members = False  # the class template lists them
numpydoc_xref_param_type = False

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",  # every example is run
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "remove_config_comments": True,
    "min_reported_time": 1e9,
}
