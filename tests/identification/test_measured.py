"""Tables of measured amplitudes: parts found, wrong points named, values within their confidence; wrong tables."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import casadi as ca
import numpy as np
import pytest

import hbnlp
from hbnlp.design import Variables
from hbnlp.identification import Measurements, identify

TRUE = {"cubic": 0.1, "force": 0.18}
WRONG = [5, 18, 30]


@pytest.fixture(scope="module")
def problem():
    return hbnlp.HarmonicBalance(hbnlp.systems.duffing(**TRUE), n_harmonics=3)


def swept(branch, omega, output):
    """Return exact amplitudes up and down: the largest solution and the smallest; and their ways."""
    sizes = [sorted(abs(s.harmonics(output)[1]) for s in branch.at(w)) for w in omega]
    ways = ["up"] * len(omega) + ["down"] * len(omega)
    return np.array([each[-1] for each in sizes] + [each[0] for each in sizes]), ways


@pytest.fixture(scope="module")
def measured(problem):
    """Eighteen frequencies up and down, 0.01 of noise, and three points that are wrong by half or more."""
    omega = np.linspace(0.8, 1.4, 18)
    amplitude, ways = swept(hbnlp.trace(problem, "omega", (0.5, 1.7), stability=None), omega, "x")
    amplitude = amplitude + 0.01 * np.random.default_rng(3).standard_normal(amplitude.size)
    amplitude[WRONG] *= [1.7, 1.5, 2.5]
    return Measurements(np.tile(omega, 2), amplitude, way=ways)


@pytest.fixture(scope="module")
def fit(problem, measured):
    variables = Variables({"cubic": (0.01, 0.5), "force": (0.05, 0.5)})
    return identify(problem, variables, measured, "x", start={"cubic": 0.13, "force": 0.15})


def test_values_are_within_their_confidence_and_wrong_points_are_named(fit, measured):
    error = np.array([fit.values[name] - TRUE[name] for name in TRUE])
    assert error @ np.linalg.solve(fit.identified.covariance, error) < 9.2  # 99 per cent of all cases
    for name, (low, high) in fit.confidence(0.99).items():
        assert low < TRUE[name] < high
    assert fit.converged
    assert fit.wrong.tolist() == WRONG
    assert not fit.used[WRONG].any()
    assert fit.used.sum() == len(measured) - len(WRONG)
    assert fit.identified.noise == pytest.approx(0.01, rel=0.4)
    for index in WRONG:
        assert measured.named(index) in repr(fit)


def test_of_several_starts_the_best_is_taken_with_and_without_workers(problem, measured, fit):
    """Half the force and a cubic stiffness ten times too small lead elsewhere, or nowhere."""
    variables = Variables({"cubic": (0.001, 0.5), "force": (0.05, 0.5)})
    starts = [{"cubic": 0.01, "force": 0.09}, {"cubic": 0.13, "force": 0.15}, {"cubic": 0.12, "force": 0.2}]
    several = identify(problem, variables, measured, "x", start=starts)
    assert several.values == pytest.approx(fit.values, rel=1e-4)
    assert len(several.led_to) == 3
    assert several.led_to[1] == pytest.approx(fit.values, rel=1e-4)
    assert "the best of 3 starts" in repr(several)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        again = identify(problem, variables, measured, "x", start=starts, executor=pool)
    assert again.values == several.values
    assert again.led_to == several.led_to


def test_starts_that_all_fail_raise_what_the_first_raised(problem, measured):
    variables = Variables({"cubic": (0.001, 0.5), "force": (0.05, 0.5)})
    with pytest.raises(ValueError, match="do not determine"):
        identify(problem, variables, Measurements([0.9], [0.6]), "x", start=[{"cubic": 0.1, "force": 0.15}] * 2)
    with pytest.raises(ValueError, match=r"start\[1\]\['force'\] is 0.6"):
        identify(problem, variables, measured, "x", start=[{"cubic": 0.1, "force": 0.15}, {"cubic": 0.1, "force": 0.6}])
    with pytest.raises(ValueError, match="one mapping"):
        identify(problem, variables, measured, "x", start=[])


def test_names_of_a_start_are_checked_before_any_fit(problem, measured, monkeypatch):
    variables = Variables({"cubic": (0.001, 0.5), "force": (0.05, 0.5)})
    monkeypatch.setattr("hbnlp.identification.measured.best_of", None)
    good = {"cubic": 0.1, "force": 0.15}
    with pytest.raises(KeyError, match=r"start\[1\] lacks 'force'"):
        identify(problem, variables, measured, "x", start=[good, {"cubic": 0.1}])
    with pytest.raises(KeyError, match=r"start\[2\]: unknown variable 'forc'.*did you mean 'force'"):
        identify(problem, variables, measured, "x", start=[good, good, {**good, "forc": 0.1}])


def test_a_start_that_raises_does_not_take_the_others_with_it(measured, caplog):
    system = hbnlp.System(
        1.0,
        0.05,
        1.0,
        nonlinear_force=lambda q, v, tau, p: (p.cubic + 1e-9 * ca.sqrt(p.force - 0.1)) * q**3,
        forcing=lambda tau, p: p.force * ca.cos(tau),
        parameters=TRUE,
        outputs={"x": lambda s: s.q[0]},
    )
    variables = Variables({"cubic": (0.01, 0.5), "force": (0.05, 0.5)})
    starts = [{"cubic": 0.1, "force": 0.06}, {"cubic": 0.13, "force": 0.15}]
    fit = identify(hbnlp.HarmonicBalance(system, 3), variables, measured, "x", start=starts)
    assert fit.led_to[0] is None
    assert fit.values == pytest.approx(TRUE, rel=0.05)
    assert "start[0] led nowhere: NonFiniteError" in caplog.text


def test_ctrl_c_during_a_trace_ends_the_identification(problem, measured, monkeypatch):
    variables, begun = Variables({"cubic": (0.01, 0.5), "force": (0.05, 0.5)}), []

    def interrupted(*arguments, **options):
        def raise_at(progress):
            if progress.counts["points"] == 20:
                raise KeyboardInterrupt

        begun.append(arguments)
        return trace(*arguments, **options, callbacks=[raise_at])

    trace = hbnlp.trace
    monkeypatch.setattr("hbnlp.identification.rounds.trace", interrupted)
    starts = [{"cubic": 0.13, "force": 0.15}] * 3
    with pytest.raises(KeyboardInterrupt):
        identify(problem, variables, measured, "x", start=starts)
    assert len(begun) == 1


def test_the_part_of_each_point_is_found_without_its_way(fit, measured):
    low, high = sorted(fold.value for fold in fit.branch.folds)
    both = (measured.omega > low) & (measured.omega < high) & fit.used
    up = np.array([way == "up" for way in measured.way])
    assert both.sum() > 6
    assert len({*fit.part[both & up]}) == len({*fit.part[both & ~up]}) == 1
    assert {*fit.part[both & up]} != {*fit.part[both & ~up]}


def test_an_amplitude_of_the_upper_part_beyond_the_fold_is_wrong_and_does_not_hold_the_fold(problem, measured):
    amplitude, omega = measured.amplitude.copy(), measured.omega.copy()
    amplitude[WRONG] = np.nan
    place = int(np.flatnonzero(omega > 1.28)[0])
    amplitude[place] = 2.9
    good = np.isfinite(amplitude)
    fit = identify(
        problem,
        Variables({"cubic": (0.01, 0.5), "force": (0.05, 0.5)}),
        Measurements(omega[good], amplitude[good]),
        "x",
        start=TRUE,
    )
    assert measured.omega[good][fit.wrong].tolist() == [omega[place]]
    assert max(fold.value for fold in fit.branch.folds) == pytest.approx(1.2696, abs=0.005)


def test_limits_that_bind_are_said(problem, measured):
    variables = Variables({"cubic": (0.01, 0.095), "force": (0.05, 0.5)})
    fit = identify(problem, variables, measured, "x", start={"cubic": 0.09, "force": 0.18})
    assert fit.at_limit == {"cubic": 0.095}
    assert np.isnan(fit.confidence()["cubic"]).all()
    assert "limits that bind: cubic 0.095" in repr(fit)


def test_the_picture_shows_points_and_residuals(fit):
    above, below = fit.plot().axes
    labels = above.get_legend_handles_labels()[1]
    assert {"measured, up", "measured, down", "wrong, left out"} <= {*labels}
    drawn = {line.get_label(): line for line in above.lines}
    assert drawn["wrong, left out"].get_xdata().tolist() == fit.measurements.omega[WRONG].tolist()
    assert below.get_ylabel() == r"residual $/\,\sigma$"
    assert "cubic" in above.get_title(loc="left")


def test_what_no_values_explain_is_not_said_to_have_converged(problem, measured):
    in_hertz = Measurements(measured.omega / (2.0 * np.pi), measured.amplitude)
    variables = Variables({"cubic": (0.01, 0.5), "force": (0.05, 0.5)})
    fit = identify(problem, variables, in_hertz, "x", start={"cubic": 0.1, "force": 0.2})
    assert not fit.converged
    assert "look at the units" in fit.message


def test_errors_that_are_a_part_of_each_amplitude_take_weights(problem):
    """Three per cent of each amplitude: with equal weights the large ones, good all of them, are taken for wrong."""
    omega = np.linspace(0.7, 1.5, 20)
    exact, _ = swept(hbnlp.trace(problem, "omega", (0.4, 1.9), stability=None), omega, "x")
    variables, start = Variables({"cubic": (0.01, 0.5), "force": (0.05, 0.5)}), {"cubic": 0.13, "force": 0.15}
    errors, evenly = [], []
    for seed in range(3):
        amplitude = exact * (1.0 + 0.03 * np.random.default_rng(seed).standard_normal(exact.size))
        measured = Measurements(np.tile(omega, 2), amplitude)
        fit = identify(problem, variables, measured, "x", start=start, weights=amplitude**-2.0)
        assert fit.converged
        assert fit.wrong.size == 0
        assert fit.identified.noise == pytest.approx(0.03, rel=0.4)
        error = np.array([fit.values[name] - TRUE[name] for name in TRUE])
        errors.append(error @ np.linalg.solve(fit.identified.covariance, error))
        evenly.append(identify(problem, variables, measured, "x", start=start).wrong.size)
    assert max(errors) < 9.2
    assert max(evenly) > 0


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"at": {"cubic": 0.3}}, r"at\['cubic'\] is 0.3; give values of parameters that are neither found nor set"),
        ({"at": {"omega": 0.3}}, r"at\['omega'\] is 0.3"),
        (
            {"start": {"cubic": 5.0, "force": 0.2}},
            r"start\['cubic'\] is 5.0; give a value within its limits, 0.01 to 0.5",
        ),
        ({"weights": np.zeros(36)}, "weights above zero"),
        ({"weights": np.ones(3)}, "weights"),
    ],
)
def test_what_would_be_ignored_is_refused(problem, measured, given, said):
    variables = Variables({"cubic": (0.01, 0.5), "force": (0.05, 0.5)})
    with pytest.raises(ValueError, match=said):
        identify(problem, variables, measured, "x", **{"start": {"cubic": 0.1, "force": 0.2}, **given})


@pytest.mark.slow
def test_stiffness_and_prestrain_of_a_wing_come_back_from_its_lift():
    true = {"stiffness": 250.0, "prestrain": 0.008}
    membrane = hbnlp.QuasiLinearMembrane(mass_ratio=0.5, **true, n_modes=3)
    wing = hbnlp.membrane_wing(
        membrane, hbnlp.aero.thin_airfoil(n_modes=3), parameters={"pitch_amplitude": np.radians(0.5)}
    )
    problem = hbnlp.HarmonicBalance(wing, n_harmonics=3)
    omega = np.linspace(2.8, 5.0, 10)
    amplitude, ways = swept(hbnlp.trace(problem, "omega", (2.5, 5.5), stability=None), omega, "C_L")
    amplitude = amplitude + 0.005 * np.random.default_rng(0).standard_normal(amplitude.size)
    amplitude[[3, 14]] *= [1.4, 0.5]
    fit = identify(
        problem,
        Variables({"stiffness": (100.0, 500.0), "prestrain": (0.002, 0.03)}),
        Measurements(np.tile(omega, 2), amplitude, way=ways),
        "C_L",
        start={"stiffness": 210.0, "prestrain": 0.0105},
    )
    error = np.array([fit.values[name] - true[name] for name in true])
    assert fit.converged
    assert error @ np.linalg.solve(fit.identified.covariance, error) < 9.2
    assert fit.wrong.tolist() == [3, 14]


# -- tables ------------------------------------------------------------------------------------------------------------


def written(folder, text):
    path = folder / "sweep.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_table_may_have_units_comments_and_other_columns(tmp_path):
    path = written(tmp_path, "# run 7\nnote;f [Hz];peak to peak (mm);way\na;0.5;4;Up\n\nb;0.25;2;\n")
    table = Measurements.from_csv(
        path, omega="f [Hz]", amplitude="peak to peak (mm)", omega_unit=2.0 * np.pi, amplitude_unit=0.5e-3
    )
    assert np.allclose(table.omega, [np.pi, 0.5 * np.pi])
    assert np.allclose(table.amplitude, [2e-3, 1e-3])
    assert table.way == ("up", "")
    assert table.lines == (3, 5)
    assert table.named(1).startswith("line 5 (omega 1.57")
    assert "2 amplitudes, 1 on the way up" in repr(table)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("omega,amplitude\n", "no measurements"),
        ("omega,size\n1,2\n", "no column 'amplitude' among 'omega', 'size'; say which it is, amplitude='...'"),
        ("omega,amplitude,amplitude\n1,2,3\n", "several columns 'amplitude'"),
        ("omega,amplitude\n1,nan\n", "line 2, column 'amplitude': 'nan'; a finite number"),
        ("omega,amplitude\n1,2\n2,\n", "line 3, column 'amplitude': ''; a finite number"),
        ("omega,amplitude\n1,-2\n", "an amplitude is not negative"),
        ("omega,amplitude\n0,2\n", "a frequency is above zero"),
        ("omega,amplitude\n1,2,3\n", "3 cells, the header has 2"),
        ("omega,amplitude\n1,0\n", "all amplitudes are zero"),
        ("omega,amplitude,way\n1,2,left\n", "column 'way': 'left'; give up, down, or nothing"),
    ],
)
def test_a_table_that_is_wrong_is_refused_with_what_to_do(tmp_path, text, said):
    with pytest.raises(hbnlp.LoadError) as raised:
        Measurements.from_csv(written(tmp_path, text))
    assert said in str(raised.value)
    assert "sweep.csv" in str(raised.value)


def test_a_cell_in_quotes_may_have_several_lines_and_other_encodings_are_named(tmp_path):
    table = Measurements.from_csv(written(tmp_path, 'note,omega,amplitude\n"a\nb",1,2\nc,2,3\n'))
    assert table.lines == (3, 4)
    assert table.amplitude.tolist() == [2.0, 3.0]
    path = tmp_path / "old.csv"
    path.write_bytes("omega,amplitude,größe\n1,2,3\n".encode("latin-1"))
    with pytest.raises(hbnlp.LoadError, match=r"no text in UTF-8: byte 18 is .*; save the table as CSV in UTF-8"):
        Measurements.from_csv(path)


def test_a_unit_in_the_header_has_to_be_said(tmp_path):
    path = written(tmp_path, "f (Hz),amplitude\n1,2\n")
    with pytest.raises(hbnlp.LoadError, match=r"is in Hz; say how much one of these is .* omega_unit="):
        Measurements.from_csv(path, omega="f (Hz)")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (([1.0, 2.0], [1.0]), "omega has 2 values and amplitude 1"),
        (([1.0, -2.0], [1.0, 1.0]), "frequencies above zero"),
        (([1.0, 2.0], [1.0, -1.0]), "not negative"),
        (([1.0, 2.0], [1.0, np.nan]), "finite numbers"),
    ],
)
def test_arrays_that_are_no_measurements_are_refused(arguments, said):
    with pytest.raises(ValueError, match=said):
        Measurements(*arguments)


def test_omega_is_no_variable(problem, measured):
    with pytest.raises(ValueError, match="omega is what was set"):
        identify(problem, Variables({"omega": (0.5, 1.5)}), measured, "x", start={"omega": 1.0})
