"""Motions drawn over their period."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import hbnlp
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.plot import plot_solutions
from hbnlp.solutions.search import Search, find_all
from hbnlp.solutions.solving import solve
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


def test_a_signal_is_drawn_over_the_whole_period():
    solution = solve(HarmonicBalance(duffing(), 5), at={"omega": 0.8})
    phases, drawn = solution.plot("x").get_lines()[0].get_data()
    np.testing.assert_allclose(drawn, solution.displacement(2.0 * np.pi / 0.8 * phases)[0], atol=1e-12)


def test_a_phase_portrait_is_value_and_rate_with_a_dot_each_period_of_the_forcing():
    solution = solve(HarmonicBalance(duffing(), 10, periods=2), at={"omega": 0.8})
    line, dots = solution.plot_phase("x").get_lines()
    t = 2.0 * np.pi / 0.8 * np.linspace(0.0, 2.0, len(line.get_xdata()))
    np.testing.assert_allclose(line.get_xdata(), solution.displacement(t)[0], atol=1e-12)
    np.testing.assert_allclose(line.get_ydata(), solution.velocity(t)[0], atol=1e-12)
    at_periods = 2.0 * np.pi / 0.8 * np.arange(2.0)
    np.testing.assert_allclose(
        dots.get_data(), [solution.displacement(at_periods)[0], solution.velocity(at_periods)[0]]
    )


def test_harmonics_are_bars_at_multiples_of_the_forcing_s_frequency():
    solution = solve(HarmonicBalance(duffing(), 6, periods=2), at={"omega": 0.8})
    ax = solution.plot_harmonics("x")
    np.testing.assert_allclose([bar.get_height() for bar in ax.patches], np.abs(solution.harmonics("x")))
    np.testing.assert_allclose([bar.get_x() + 0.5 * bar.get_width() for bar in ax.patches], np.arange(7) / 2)
    assert solution.plot_harmonics("x", logarithmic=True).get_yscale() == "log"


def test_a_time_response_is_drawn_as_it_was_integrated():
    response = hbnlp.integrate(hbnlp.systems.duffing(), at={"omega": 0.7}, periods=2, periodic_tol=1e-3)
    ax = response.plot("x", color="tab:red")
    drawn = ax.lines[0]
    assert np.array_equal(drawn.get_ydata(), response.signal("x"))
    assert np.allclose(drawn.get_xdata(), np.arange(response.t.size) * 2.0 / response.t.size)
    assert ax.get_xlim() == (0.0, 2.0)
    with pytest.raises(KeyError, match="unknown output"):
        response.plot("y")
