"""The form of the examples. They run, warn of nothing and meet their own assertions once, as the gallery is built."""

import pkgutil
import re
from pathlib import Path

import pytest
from gallery_pages import READING_ORDER

FOLDER = Path(__file__).parents[1] / "examples"
EXAMPLES = sorted(FOLDER.rglob("*.py"))
examples = pytest.mark.parametrize("script", EXAMPLES, ids=lambda path: path.stem)


def code_of(script):
    return script.read_text(encoding="utf-8").split('"""', 2)[2]


@examples
def test_an_example_is_short_and_asserts_its_headline_number(script):
    code = code_of(script)
    assert len([line for line in code.splitlines() if line.strip()]) <= 70
    assert "assert " in code


@examples
def test_an_example_ends_in_one_figure_saved_under_its_own_name(script):
    *before, last = code_of(script).split("\n# %%\n")
    assert last.count(".savefig(") == 1
    assert f'.savefig("{script.stem}.png", ' in last
    assert not any(".savefig(" in block for block in before)
    assert ".show(" not in code_of(script)


@examples
def test_the_names_that_an_example_takes_from_the_package_exist(script):
    names = set(re.findall(r"\bhbnlp((?:\.\w+)+)", code_of(script)))
    assert names or "from hbnlp import" in code_of(script)
    for name in names:
        pkgutil.resolve_name(f"hbnlp{name}")


def test_each_example_has_its_place_in_a_folder_of_the_gallery():
    folders = {folder: {script.stem for script in (FOLDER / folder).glob("*.py")} for folder in READING_ORDER}
    assert folders == {folder: set(names) for folder, names in READING_ORDER.items()}
    assert len(EXAMPLES) == sum(map(len, READING_ORDER.values()))
    assert all((FOLDER / folder / "GALLERY_HEADER.rst").is_file() for folder in READING_ORDER)
