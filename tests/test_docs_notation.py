"""The page of letters: every module that it names is there."""

import importlib
import re
from pathlib import Path

import hbnlp

PAGE = Path(__file__).parents[1] / "docs" / "notation.md"


def named_modules():
    rows = [line.split("|") for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    return sorted({name for row in rows for name in re.findall(r"`([a-z_.]+)`", row[-2])})


def test_every_module_in_the_column_of_modules_can_be_imported():
    assert len(named_modules()) > 10
    for name in named_modules():
        importlib.import_module(f"{hbnlp.__name__}.{name}")
