"""The house: rooms that say what lives in them, a short contract, short functions and classes, sources at hand."""

import ast
import importlib
import inspect
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "hbnlp"
MODULES = sorted(PACKAGE.rglob("*.py"))
ROOMS = sorted({path.parent for path in MODULES} - {PACKAGE})
PUBLIC = ("hbnlp", "hbnlp.aero", "hbnlp.design", "hbnlp.dns", "hbnlp.identification", "hbnlp.systems")
LONGEST_FUNCTION, MOST_METHODS, LONGEST_CONTRACT = 50, 15, 14
"""More need a reason in the docstring, after the words "Many statements:" or "Many methods:"."""


def name_of(path):
    return path.relative_to(ROOT).as_posix()


def definitions(kind):
    return [
        (f"{name_of(path)}: {node.name}", node)
        for path in MODULES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, kind)
    ]


def without_reason(node, words):
    return f"{words}: " not in " ".join((ast.get_docstring(node) or "").split())


def test_functions_are_short_or_say_why_not():
    long = {}
    for name, node in definitions(ast.FunctionDef):
        statements = sum(isinstance(inner, ast.stmt) for inner in ast.walk(node)) - 1
        if statements > LONGEST_FUNCTION and without_reason(node, "Many statements"):
            long[name] = statements
    assert long == {}


def test_classes_have_few_methods_or_say_why_not():
    large = {}
    for name, node in definitions(ast.ClassDef):
        methods = len({inner.name for inner in node.body if isinstance(inner, ast.FunctionDef)})
        if methods > MOST_METHODS and without_reason(node, "Many methods"):
            large[name] = methods
    assert large == {}


def test_no_module_is_named_after_a_public_function():
    functions = set()
    for place in PUBLIC:
        module = importlib.import_module(place)
        functions |= {name for name in module.__all__ if inspect.isfunction(getattr(module, name))}
    assert "trace" in functions
    assert [name_of(path) for path in (*MODULES, *ROOMS) if path.stem in functions] == []


@pytest.mark.parametrize("room", ROOMS, ids=name_of)
def test_every_room_says_in_one_sentence_what_lives_there(room):
    line = (ast.get_docstring(ast.parse((room / "__init__.py").read_text(encoding="utf-8"))) or "").partition("\n")[0]
    assert re.fullmatch(r"[A-Z][^.]*\.", line), line


def test_the_tests_have_the_rooms_of_the_package():
    folders = {path.parent.relative_to(ROOT / "tests") for path in (ROOT / "tests").rglob("test_*.py")} - {Path()}
    assert {str(folder) for folder in folders} == {room.name for room in ROOMS if room.parent == PACKAGE}


def test_the_contract_of_the_rooms_is_short():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (layers,) = [c["layers"] for c in project["tool"]["importlinter"]["contracts"] if c["type"] == "layers"]
    assert len(layers) <= LONGEST_CONTRACT


def test_the_page_on_how_it_is_built_names_files_that_exist():
    page = (ROOT / "docs" / "how_it_is_built.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(\w+/\w+\.py)`", page))
    assert len(named) > 20
    assert [file for file in sorted(named) if not any((root / file).is_file() for root in (PACKAGE, ROOT))] == []
    rooms = {
        room for cell in re.findall(r"^\| (`.*?) \|", page, flags=re.MULTILINE) for room in re.findall(r"`(\w+)`", cell)
    }
    assert rooms == {path.stem for path in PACKAGE.iterdir() if path.suffix in ("", ".py") and path.stem[0] != "_"}


def texts():
    """What readers see: the documents at the top, and all code and pages in the folders."""
    yield from ROOT.glob("*.md")
    for folder in ("hbnlp", "tests", "docs", "examples", "benchmarks"):
        for suffix in ("py", "md", "rst"):
            yield from (p for p in (ROOT / folder).rglob(f"*.{suffix}") if "_build" not in p.parts)


def test_no_source_is_a_document_that_the_repository_does_not_hold():
    """A document is named in capitals with a section, or as a file of text (one in quotation marks is made)."""
    at_hand = {path.name for path in texts()}
    missing = []
    for path in texts():
        text = path.read_text(encoding="utf-8")
        missing += [f"{name_of(path)}: {found}" for found in re.findall(r"\b[A-Z]{3,}[A-Z_]*\b,?\s+section \d+", text)]
        files = re.findall(r"(?<![\w\"-])([\w-]+\.(?:md|rst|pdf|docx))\b", text)
        missing += [f"{name_of(path)}: {file}" for file in files if file not in at_hand]
    assert missing == []


def test_no_text_names_a_path_of_a_machine():
    paths = re.compile(r"(?<![\w.:/])(?:/(?:root|home|work|Users|mnt|tmp)/|[A-Z]:\\)")
    assert [name_of(path) for path in texts() if paths.search(path.read_text(encoding="utf-8"))] == []
