"""Every example runs, warns of nothing, meets its own assertions (its headline number) and writes its figure."""

import os
import runpy
from pathlib import Path

import matplotlib
import pytest
from matplotlib import pyplot as plt

EXAMPLES = sorted(Path(__file__).parents[1].joinpath("examples").glob("*.py"))
QUICK = {"absorber_isola", "own_equations"}


@pytest.mark.parametrize(
    "script",
    [pytest.param(path, marks=() if path.stem in QUICK else pytest.mark.slow, id=path.stem) for path in EXAMPLES],
)
def test_example_meets_its_assertions_and_writes_its_figure(script, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert matplotlib.get_backend().lower() == "agg"
    try:
        runpy.run_path(os.fspath(script), run_name="__main__")
    finally:
        plt.close("all")
    figure = tmp_path / "figures" / f"{script.stem}.png"
    assert figure.stat().st_size > 10_000


def test_examples_are_short_and_say_what_they_show():
    for script in EXAMPLES:
        text = script.read_text(encoding="utf-8")
        code = text.split('"""', 2)[2]
        assert len([line for line in code.splitlines() if line.strip()]) <= 70, script.name
        assert "assert " in code, script.name
        assert ".show(" not in code, script.name
        assert f"figures/{script.stem}.png" in code, script.name
