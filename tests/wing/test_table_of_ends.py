"""The tables of ends on the page of the paper's claims are those of the stored results, number by number."""

import csv
import re
from pathlib import Path

import pytest

from hbnlp.testing import stored_result

PAGE = Path(__file__).parents[2] / "docs" / "paper.md"
TITLES = {"quasi_linear": "Quasi-linear membrane:", "nonlinear": "Full membrane:"}
MINUS, DASH = "\N{MINUS SIGN}", "\N{EN DASH}"
TOLERANCES = ("tolerance 1e-02", "as is", "tolerance 1e-04")
CHANGED = ("15 modes", "20 modes", "all poles", "flow solver 25 cells", "flow solver 50 cells")


def stored(membrane):
    """Results by (frequency of the end to three decimals, variant)."""
    with stored_result(f"wing_ends_{membrane}.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    known = {row["end"]: f"{float(row['omega']):.3f}" for row in rows if row["variant"] == "as is"}
    return {(known[row["end"]], row["variant"]): row for row in rows if row["end"] in known}


def printed(membrane):
    """The rows of the table, cell by cell."""
    lines = PAGE.read_text(encoding="utf-8").partition(TITLES[membrane])[2].lstrip().splitlines()
    table = lines[: next(i for i, line in enumerate(lines) if not line.startswith("|"))]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table[2:]]


def shown(text):
    """A multiplier as the page writes it."""
    number = complex(text)
    real = f"{number.real:.3f}".replace("-", MINUS)
    return "1" if abs(number.imag) < 1e-9 else f"{real} ± {abs(number.imag):.3f}i"


@pytest.mark.parametrize("membrane", TITLES)
def test_the_printed_ends_are_the_stored_ones(membrane):
    results, rows = stored(membrane), printed(membrane)
    assert len(rows) >= 6
    for _, kind, omega, multiplier, harmonics, camber, tension, *changes in rows:
        end = results[omega, "as is"]
        assert kind == end["kind"]
        assert multiplier == shown(end["multiplier"])
        assert camber == f"{float(end['camber']):.3f}"
        assert tension == f"{100 * float(end['tension_error']):.1f}"
        of_tolerances = [results.get((omega, name), {}).get("n_harmonics") or DASH for name in TOLERANCES]
        assert harmonics == ", ".join(of_tolerances)
        for cell, name in zip(changes, CHANGED, strict=True):
            there = results.get((omega, name), {}).get("omega")
            wanted = f"{100 * (float(there) / float(end['omega']) - 1):+.2f}".replace("-", MINUS) if there else DASH
            assert cell == wanted, (omega, name)


@pytest.mark.parametrize(
    ("membrane", "begin", "end"),
    [
        ("quasi_linear", "Stable motions of the", "Of the full membrane:"),
        ("nonlinear", "Of the full membrane:", "Its diagram has"),
    ],
)
def test_the_motions_that_the_page_names_are_the_stable_stretches(membrane, begin, end):
    text = PAGE.read_text(encoding="utf-8").partition(begin)[2].partition(end)[0]
    with stored_result(f"wing_stretches_{membrane}.csv").open(encoding="utf-8") as stream:
        stretches = list(csv.DictReader(stream))
    ends = {f"{float(stretch[side]):.3f}" for stretch in stretches for side in ("low", "high")}
    named = set(re.findall(r"\d+\.\d{3}", text))
    assert named <= ends
    # and no stretch of some width is left out
    wide = [s for s in stretches if float(s["high"]) / float(s["low"]) > 1.1]
    assert all({f"{float(s['low']):.3f}", f"{float(s['high']):.3f}"} & named for s in wide)


@pytest.mark.parametrize("membrane", TITLES)
def test_the_page_says_by_how_much_the_tolerance_moves_the_ends(membrane):
    results = stored(membrane)
    said = r"with 1e-2 and 1e-4 the ends in these tables are the same to (\S+) \(one of the five left out to (\S+)\),"
    ((most, of_others),) = re.findall(said, " ".join(PAGE.read_text(encoding="utf-8").split()))
    in_table = {row[2] for row in printed(membrane)}
    for omega, name in results:
        if name in TOLERANCES and results[omega, name]["omega"]:
            change = float(results[omega, name]["omega"]) / float(results[omega, "as is"]["omega"]) - 1
            assert abs(change) <= float(most if omega in in_table else of_others), (omega, name)
