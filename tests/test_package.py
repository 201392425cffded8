"""The package as a user meets it: its version, its public names, what importing it costs, and the code in its texts."""

import functools
import importlib.metadata
import inspect
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import hbnlp
import hbnlp.design
import hbnlp.identification
import hbnlp.plot
import hbnlp.testing

ROOT = Path(__file__).parents[1]


def run_python(code, folder):
    """Run code in a new Python, warnings as errors, within folder."""
    command = [sys.executable, "-W", "error", "-c", code]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=240)


def test_importing_the_package_does_not_import_matplotlib_or_an_extra(tmp_path):
    code = (
        "import sys, hbnlp; print(sorted({'matplotlib', 'control', 'xarray', 'pandas', 'h5netcdf'} & set(sys.modules)))"
    )
    done = run_python(code, tmp_path)
    assert done.stderr == ""
    assert done.stdout.strip() == "[]"


def test_the_version_is_the_same_everywhere():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert citation is not None
    assert project["version"] == citation[1] == importlib.metadata.version("hbnlp") == hbnlp.__version__


def test_the_changelog_knows_the_version():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## [{importlib.metadata.version('hbnlp')}]" in text


def test_every_public_name_exists_and_is_documented():
    assert len(set(hbnlp.__all__)) == len(hbnlp.__all__)
    undocumented = [name for name in hbnlp.__all__ if not getattr(hbnlp, name).__doc__ and name != "__version__"]
    assert undocumented == []


def test_every_public_name_is_in_the_reference():
    pages = [page.read_text(encoding="utf-8") for page in sorted(ROOT.glob("docs/api/*.rst"))]
    entries = re.findall(r"^   ([\w.]+)$", "\n".join(pages), flags=re.MULTILINE)
    listed = [functools.reduce(getattr, entry.split("."), hbnlp) for entry in entries]
    public = [getattr(hbnlp, name) for name in hbnlp.__all__]
    public += [
        getattr(module, name)
        for module in public
        if inspect.ismodule(module)
        for name in vars(module).get("__all__", ())
    ]
    missing = [thing for thing in public if not inspect.ismodule(thing) and thing not in listed]
    assert missing == []
