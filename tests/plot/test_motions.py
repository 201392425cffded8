"""Motions drawn over their period."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from hbnlp.balance.problem import HarmonicBalance
from hbnlp.plot import plot_solutions
from hbnlp.solutions.search import Search, find_all
from hbnlp.systems import duffing
from hbnlp.systems.system import System


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")


def test_all_solutions_of_a_set_are_drawn_over_their_period():
    found = find_all(HarmonicBalance(duffing(), 6, periods=2), at={"omega": 1.2}, method=Search(n_starts=5))
    ax = found.plot("x")
    assert [text.get_text() for text in ax.get_legend().get_texts()] == [f"solution {k + 1}" for k in range(len(found))]
    for line, solution in zip(ax.get_lines(), found, strict=True):
        phases, drawn = line.get_data()
        assert (phases[0], phases[-1]) == (0.0, 2.0)
        np.testing.assert_allclose(drawn, solution.displacement(2.0 * np.pi / 1.2 * phases)[0], atol=1e-9)
        assert drawn[0] == pytest.approx(drawn[-1])
    assert plot_solutions(found, "x", ax=ax, color="k") is ax
    assert len(ax.get_lines()) == 2 * len(found)
    with pytest.raises(KeyError, match=r"unknown output 'y' \(known: x\)"):
        found.plot("y")


def test_there_is_nothing_to_draw_where_nothing_was_found():
    drifting = System(1.0, 0.0, 0.0, forcing=lambda tau, p: [-1.0])
    found = find_all(HarmonicBalance(drifting, 1), at={"omega": 1.0}, method=Search(n_starts=0))
    with pytest.raises(ValueError, match="the solution set has no solutions to draw: no random starts were asked for"):
        found.plot("x")
