"""Slow marches by Runge-Kutta, and the motions traced to a tolerance: two ways that know nothing of each other.

Both are stored; ``benchmarks/validation/membrane_wing`` makes them (march.py, diagram.py).
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import hbnlp

RESULTS = Path(__file__).parents[2] / "benchmarks" / "validation" / "results"
MEMBRANES = ("quasi_linear", "nonlinear")
SETTLED = 2.5e-3
"""Change of the state over twelve units of time."""
MODULATED = 0.01
"""Lift between the harmonics of the pitch, relative to the first of them."""
SUBCRITICAL = {("nonlinear", "up"): 60.278955, ("nonlinear", "down"): 43.503881}
"""Branch points at both ends of one branch of unstable motions, which close around the stable one before them."""
membranes = pytest.mark.parametrize("membrane", MEMBRANES)
marches = pytest.mark.parametrize(("membrane", "way"), [(m, way) for m in MEMBRANES for way in ("up", "down")])


def stored(name):
    return np.genfromtxt(RESULTS / f"wing_{name}.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")


def stable_stretches(membrane):
    """Return (omega, |C_L|) of the stable parts of all branches, cut where they turn."""
    curve, found = stored(f"diagram_{membrane}"), []
    for number in np.unique(curve["branch"]):
        part = curve[curve["branch"] == number]
        turns = np.flatnonzero(np.diff(np.sign(np.diff(part["omega"])))) + 1
        changes = np.flatnonzero(np.diff(part["stable"])) + 1
        for begin, end in pairwise(sorted({0, *turns, *changes, len(part)})):
            piece = np.sort(part[begin:end], order="omega")
            if part["stable"][begin] and len(piece) > 1:
                found.append((piece["omega"], piece["lift_1"]))
    return found


def ends(membrane):
    points = stored(f"points_{membrane}")
    return points["omega"][points["changes"] == 1]


@marches
def test_every_jump_of_a_march_has_a_special_point_of_the_traced_motions_in_its_bracket(membrane, way):
    march, found = stored(f"march_{membrane}_{way}"), 0
    for i in np.flatnonzero(march["jump"]):
        low, high = sorted(march["omega"][i - 1 : i + 1])
        assert high / low < 1.0035
        inside, pitchfork = ends(membrane), SUBCRITICAL.get((membrane, way), np.inf)
        if (
            march["between"][i - 1] < 0.05 * march["lift_1"][i - 1]
        ):  # else a modulated motion ended, which is not traced
            beside = abs(low / pitchfork - 1.0) < 0.01
            assert beside or np.any((low < inside) & (inside < high)), (low, high)
            found += 1
    assert found >= 1


@pytest.mark.parametrize("way", ["up", "down"])
def test_a_march_by_integration_falls_where_a_march_through_the_diagram_does(way):
    march, legs = stored(f"march_quasi_linear_{way}"), stored("falls_quasi_linear")
    legs = legs[(legs["way"] == way) & np.isfinite(legs["falls_at"])]
    brackets = [sorted(march["omega"][i - 1 : i + 1]) for i in np.flatnonzero(march["jump"])]
    assert len(legs) == len(brackets)
    for leg, (low, high) in zip(legs, brackets, strict=True):
        # along modulated motions the diagram's march goes in steps of one per cent
        slack = 0.03 if leg["next"] == "lost" else 0.0
        assert low * (1.0 - slack) < leg["falls_at"] < high * (1.0 + slack)


@membranes
def test_the_ends_of_the_intervals_are_special_points_at_which_stability_changes(membrane):
    for interval in np.atleast_1d(stored(f"intervals_{membrane}")):
        for value, kind in ((interval["low"], interval["at_low"]), (interval["high"], interval["at_high"])):
            assert kind == "end" or np.min(abs(ends(membrane) / value - 1.0)) < 1e-6


@marches
def test_a_march_and_the_traced_motions_agree_to_half_a_per_cent_where_it_has_settled(membrane, way):
    march, stretches = stored(f"march_{membrane}_{way}"), stable_stretches(membrane)
    settled = (march["change"] < SETTLED) & (march["between"] < MODULATED * march["lift_1"])
    assert np.count_nonzero(settled) > 0.7 * len(march)
    for row in march[settled]:
        omega = row["omega"]
        here = [(w, lift) for w, lift in stretches if w[0] <= omega <= w[-1]]
        traced = [np.exp(np.interp(np.log(omega), np.log(w), np.log(lift))) for w, lift in here]
        beside = (
            np.min(abs(omega / stored(f"points_{membrane}")["omega"] - 1.0)) < 0.03
        )  # beyond the last point before an end
        assert beside or np.min(abs(np.array(traced) / row["lift_1"] - 1.0)) < 5e-3, omega


@membranes
def test_integration_from_every_stable_stretch_one_per_cent_larger_comes_back_to_it(membrane):
    reached = np.atleast_1d(stored(f"reached_{membrane}"))
    reached = reached[reached["begin"] != reached["end"]]  # stretches of one point are as wide as what is added
    assert len(reached) >= 5
    for harmonic in (1, 3):
        traced, integrated = reached[f"traced_{harmonic}"], reached[f"integrated_{harmonic}"]
        assert np.all(abs(integrated / traced - 1.0) < 5e-3)


@membranes
def test_a_fold_of_the_motions_traced_to_a_tolerance_has_a_multiplier_of_one(membrane):
    points = stored(f"points_{membrane}")
    multipliers = points["multiplier"][points["kind"] == "fold"].astype(complex)
    assert np.all(abs(multipliers - 1.0) < 1e-3)
    assert np.all(points["truncation_error"] <= 1e-3)
    assert points["n_harmonics"].max() <= 64


def test_the_ends_of_the_quasi_linear_motions_at_two_and_a_half_degrees():
    for value in (4.57710, 9.14964, 39.35736):
        assert np.min(abs(ends("quasi_linear") / value - 1.0)) < 1e-5


@pytest.mark.parametrize(("way", "folds"), [("up", (7.60533, 15.96724, 45.43943)), ("down", (4.54771,))])
def test_the_full_membrane_is_left_at_the_folds_of_its_motions(way, folds):
    march, found = stored(f"march_nonlinear_{way}"), ends("nonlinear")
    brackets = [sorted(march["omega"][i - 1 : i + 1]) for i in np.flatnonzero(march["jump"])]
    for fold in folds:
        assert np.min(abs(found / fold - 1.0)) < 1e-6
        assert any(low < fold < high for low, high in brackets)


def ends_of_motions(membrane):
    """Return {(end, variant): omega} of the kept table."""
    rows = stored(f"ends_{membrane}")
    return {(row["end"], row["variant"]): row for row in rows if np.isfinite(row["omega"])}


@membranes
def test_the_ends_of_the_motions_do_not_hang_on_the_tolerance(membrane):
    table = ends_of_motions(membrane)
    for (end, variant), row in table.items():
        if variant.startswith("tolerance"):
            most = 2e-6 if end == 45.866 else 1e-6  # a Neimark-Sacker point near +1, one of those the page leaves out
            assert abs(row["omega"] / table[end, "as is"]["omega"] - 1.0) < most


@membranes
def test_the_ends_of_the_motions_have_critical_multipliers(membrane):
    for row in ends_of_motions(membrane).values():
        multiplier = complex(row["multiplier"])
        if np.isnan(multiplier):  # too dear to be asked for
            assert row["variant"].endswith("modes")
            continue
        assert abs(abs(multiplier) - 1.0) < 1e-3
        assert row["kind"] == "Neimark-Sacker" or abs(multiplier - 1.0) < 1e-3


@pytest.mark.parametrize("full", [False, True])
def test_a_short_trace_with_nine_harmonics_comes_to_the_kept_beginning_of_the_quiet_motion(full):
    rom = hbnlp.aero.flat_plate_re100(full=full)
    membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, stiffness=250.0, prestrain=0.002, n_modes=10)
    problem = hbnlp.HarmonicBalance(hbnlp.membrane_wing(membrane, rom), 9)
    quiet = hbnlp.solve(problem, at={"pitch_amplitude": np.radians(2.5), "omega": 10.0})
    points = (each.special_points for each in hbnlp.Tracer(quiet, "omega", (10.0, 4.0), stability=None))
    fold = next(found[0] for found in points if found)
    kept = ends_of_motions("quasi_linear")[4.5771, "all poles" if full else "as is"]
    assert (fold.kind.value, kept["kind"]) == ("fold", "fold")
    assert fold.value == pytest.approx(kept["omega"], rel=1e-6)


@membranes
def test_the_first_tongue_begins_at_the_traced_fold_of_the_quiet_motion(membrane):
    tongue = stored(f"tongue_{membrane}")
    line = tongue[tongue["event"] == ""]
    cusp = min(tongue[tongue["event"] == "cusp"], key=lambda row: row["omega"])  # the full membrane's has others
    assert line["degrees"].min() < cusp["degrees"] < 1.25
    # from the cusp on to the quiet motion's side, on which omega rises with the amplitude
    side = line[np.argmin(np.hypot(line["omega"] - cusp["omega"], line["degrees"] - cusp["degrees"])) :]
    omega = np.interp(2.5, side["degrees"], side["omega"])
    assert np.min(abs(ends(membrane) - omega)) < 2e-3 * omega
    assert np.all(line["truncation_error"] <= 1e-3)


def test_one_unstable_branch_closes_on_both_subcritical_branch_points():
    """Between them, where the symmetric motion is stable, it is unstable, and it meets that motion at both ends."""
    low, high = sorted(SUBCRITICAL.values())
    diagram = stored("diagram_nonlinear")
    parts = [diagram[diagram["branch"] == number] for number in np.unique(diagram["branch"])]
    (shared,) = [
        p for p in parts if abs(p["omega"].min() / low - 1.0) < 1e-3 and abs(p["omega"].max() / high - 1) < 1e-3
    ]
    assert not shared["stable"].any()
    assert low < shared["omega"].min() < shared["omega"].max() < high


@pytest.mark.parametrize(("highest", "ups", "downs"), [(20, 1, 1), (60, 2, 1)])
def test_marches_at_twenty_amplitudes_agree_at_the_papers_with_those_to_a_finer_tolerance(highest, ups, downs):
    legs = stored(f"amplitudes_{highest}")
    assert len(np.unique(legs["degrees"])) == 20
    mine = legs[legs["degrees"] == 2.5]
    for way, count in (("up", ups), ("down", downs)):
        falls = mine[(mine["way"] == way) & (mine["at"] == "fold")]
        assert len(falls) == count
        for fall in falls:
            assert np.min(abs(ends("quasi_linear") / fall["falls_at"] - 1.0)) < 1e-5


def test_where_marches_to_a_tolerance_fall_at_other_amplitudes():
    """What figure 3's page says of them: the resonant motion's end, the next one's, the first fall of a march down."""
    legs = stored("amplitudes_60")
    up, down = (legs[(legs["way"] == way) & np.isfinite(legs["falls_at"])] for way in ("up", "down"))
    for degrees, place in ((1.5, 6.2), (10.0, 30.7), (1.5, 14.2), (2.0, 25.8), (2.5, 39.4), (3.0, 55.5)):
        assert np.min(abs(up["falls_at"][up["degrees"] == degrees] - place)) < 0.05
    firsts = [down["falls_at"][down["degrees"] == degrees][0] for degrees in np.unique(down["degrees"])]
    assert len(firsts) == 20
    assert (np.round(min(firsts), 1), np.round(max(firsts))) == (18.9, 53.0)


def test_marches_up_to_sixty_fall_where_those_up_to_twenty_do():
    both = [stored(f"amplitudes_{highest}") for highest in (20, 60)]
    near, far = ({(leg["degrees"], f"{leg['falls_at']:.5g}") for leg in legs if leg["way"] == "up"} for legs in both)
    assert {each for each in near if each[1] != "nan"} <= far


@pytest.mark.parametrize("way", ["up", "down"])
def test_a_march_of_half_the_steps_leaves_its_motions_at_the_same_places(way):
    brackets = []
    for name in (f"march_quasi_linear_{way}", f"march_quasi_linear_{way}_halved"):
        march = stored(name)
        brackets.append([sorted(march["omega"][i - 1 : i + 1]) for i in np.flatnonzero(march["jump"])])
    assert len(brackets[0]) == len(brackets[1]) == 2
    for (low, high), (lower, higher) in zip(*brackets, strict=True):
        assert max(low, lower) < min(high, higher)


def test_marches_through_the_full_membranes_diagram_leave_its_motions_where_integration_does():
    """Beyond their last legs the motions are modulated, and the diagram does not say where they go."""
    legs, march = stored("falls_nonlinear"), stored("march_nonlinear_up")
    brackets = [sorted(march["omega"][i - 1 : i + 1]) for i in np.flatnonzero(march["jump"])]
    falls = legs[(legs["way"] == "up") & np.isfinite(legs["falls_at"])]
    assert len(falls) == 3
    for leg, (low, high) in zip(falls, brackets[:3], strict=True):
        assert low < leg["falls_at"] < high
    (left,) = legs[legs["way"] == "down"]
    march = stored("march_nonlinear_down")
    modulated = march["omega"][march["between"] > 0.05 * march["lift_1"]]
    assert left["at"] == "Neimark-Sacker"
    assert modulated.max() == pytest.approx(left["leaves"], rel=0.03)
    assert modulated.max() < left["leaves"]
