"""The Python blocks of README and documentation run as written: those of one page, in order, are one script."""

import os
import re
from pathlib import Path

import pytest
from matplotlib import pyplot as plt

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
TEXTS = (ROOT / "README.md", *sorted(ROOT.glob("docs/*.md")))
PAGES = [page for page in TEXTS if BLOCK.search(page.read_text(encoding="utf-8"))]
SLOW = {"dns"}


def script_of(page):
    """Return the blocks of a page as one script whose line numbers are the page's."""
    text = page.read_text(encoding="utf-8")
    kept = ["\n"] * (text.count("\n") + 1)
    for block in BLOCK.finditer(text):
        first = text.count("\n", 0, block.start(1))
        for offset, line in enumerate(block.group(1).splitlines(keepends=True)):
            kept[first + offset] = line
    return "".join(kept)


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=pytest.mark.slow if page.stem in SLOW else (), id=page.stem) for page in PAGES],
)
def test_blocks_of_a_page_run_in_order(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    try:
        exec(compile(script_of(page), os.fspath(page), "exec"), {"__name__": "__main__"})  # noqa: S102  our own pages
    finally:
        plt.close("all")
    if page.stem == "README":
        assert (tmp_path / "hysteresis.png").stat().st_size > 10_000
