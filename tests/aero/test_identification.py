"""Identification: known rational functions are found exactly, the rest as well as the theory says."""

import dataclasses
import re

import numpy as np
import pytest

from hbnlp.aero import AeroROM, theodorsen_transfer
from hbnlp.aero.frequency_response import FrequencyResponse
from hbnlp.aero.identification import (
    PoleFit,
    ShortRecordWarning,
    balanced_truncation,
    identify,
    realise,
    reduce_to_band,
    vector_fit,
)
from hbnlp.aero.identification.modal import lag_states, sort_poles

OMEGA = np.geomspace(0.01, 100.0, 60)


def known_fit(n_modes=2, seed=1):
    rng = np.random.default_rng(seed)
    poles = sort_poles([-0.1, -1.0, -8.0, -0.5 + 2.0j, -3.0 + 9.0j])
    shape = (n_modes + 1, n_modes + 2)
    residues = rng.normal(size=(poles.size, *shape)).astype(complex)
    for i in np.flatnonzero(poles.imag > 0.0):
        residues[i] += 1j * rng.normal(size=shape)
        residues[i + 1] = residues[i].conj()
    k, d, m = rng.normal(size=(3, *shape))
    return PoleFit(poles=poles, residues=residues, stiffness=k, damping=d, mass=m)


def response_of(fit, omega=OMEGA):
    return FrequencyResponse(
        omega=omega,
        values=fit.transfer(1j * omega),
        static=fit.stiffness,
        base_load=np.zeros(len(fit.stiffness)),
    )


def rom_of(fit):
    a, b, c = lag_states(fit.poles, fit.residues)
    return AeroROM(stiffness=fit.stiffness, damping=fit.damping, mass=fit.mass, lag_state=a, lag_input=b, lag_output=c)


def theodorsen_response(n_modes=3, omega=OMEGA):
    return FrequencyResponse(
        omega=omega,
        values=theodorsen_transfer(1j * omega, n_modes=n_modes),
        static=theodorsen_transfer(np.array([0.0]), n_modes=n_modes)[0].real,
        base_load=np.zeros(n_modes + 1),
    )


def test_vector_fitting_finds_a_rational_function_exactly():
    truth = known_fit()
    found = vector_fit(response_of(truth), n_poles=truth.poles.size)
    assert found.poles == pytest.approx(truth.poles, rel=1e-9)
    for name in ("stiffness", "damping", "mass", "residues"):
        np.testing.assert_allclose(getattr(found, name), getattr(truth, name), rtol=1e-8, atol=1e-8)


def test_the_static_value_is_exact_whatever_the_order():
    response = theodorsen_response()
    rom = identify(response, tolerance=0.1, most_poles=4).rom
    assert np.array_equal(rom.transfer(0.0).real, response.static)


def test_known_columns_of_damping_are_kept():
    response = theodorsen_response()
    # inviscid, so no drag: heave velocity is minus incidence
    known = -response.static[:, 0]
    fit = vector_fit(response, n_poles=6, damping={1: known})
    assert np.array_equal(fit.damping[:, 1], known)
    found = identify(response, tolerance=1e-2, damping={1: known}, n_lags=4)
    assert np.array_equal(found.rom.damping[:, 1], known)


def test_theodorsens_function_is_fitted_to_the_tolerance_with_stable_poles():
    found = identify(theodorsen_response(), tolerance=1e-3)
    assert found.error <= 1e-3
    assert found.rom.poles.real.max() < 0.0


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_noise_is_not_fitted_by_more_poles(seed, caplog):
    """Of 2 %: the error of the ROM is below the noise, and the log says what the noise is."""
    exact, rng = theodorsen_response(), np.random.default_rng(seed)
    errors = rng.standard_normal((2, *exact.values.shape)) / np.sqrt(2.0)
    noisy = exact.values + 0.02 * np.abs(exact.values) * (errors[0] + 1j * errors[1])
    found = identify(dataclasses.replace(exact, values=noisy))
    assert found.n_poles == 4
    assert exact.column_errors(found.rom.transfer(1j * OMEGA)).max() < 0.02
    (record,) = caplog.records
    assert re.search(
        rf"the error is {found.error:.2e} with 4 poles, .* up to 40 poles only fit the noise, some 2.0e-02: set toler",
        record.getMessage(),
    )


def test_data_without_noise_get_the_poles_that_help_also_where_the_tolerance_is_not_reached(caplog):
    response = theodorsen_response()
    found = identify(response, tolerance=1e-9, most_poles=12)
    assert found.n_poles == 12
    assert "more poles may reach it, most_poles" in caplog.text


def test_a_file_name_is_no_response():
    with pytest.raises(TypeError, match=r"response is 'own.csv'; give a FrequencyResponse, .*from_csv"):
        identify("own.csv")


def test_a_fit_gets_better_with_every_four_poles():
    response = theodorsen_response()
    errors = [response.column_errors(vector_fit(response, n_poles=n).transfer(1j * OMEGA)).max() for n in (2, 6, 10)]
    assert errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.5 * errors[1]


def test_lag_states_have_the_poles_and_residues():
    truth = known_fit()
    a, b, c = lag_states(truth.poles, truth.residues)
    # three real poles and two pairs, all of full rank 3
    assert a.shape == (3 * 3 + 2 * 2 * 3,) * 2
    s = 0.3 + 1.7j
    direct = sum(r / (s - p) for p, r in zip(truth.poles, truth.residues, strict=True))
    np.testing.assert_allclose(c @ np.linalg.solve(s * np.eye(len(a)) - a, b), direct, rtol=1e-12, atol=1e-12)


def test_balanced_truncation_keeps_stability_and_the_bound_of_the_theory():
    rom = rom_of(known_fit())
    for n in (3, 8, 15):
        reduced, values = balanced_truncation(rom, n)
        assert reduced.n_lags == n
        assert reduced.poles.real.max() < 0.0
        s = 1j * np.geomspace(1e-3, 1e3, 200)
        difference = (reduced.transfer(s) - rom.transfer(s)) / (s**2)[:, None, None]
        # twice the sum of the neglected Hankel singular values (Enns; Glover)
        assert np.linalg.norm(difference, 2, axis=(1, 2)).max() <= 2.0 * values[n:].sum() * (1.0 + 1e-6)


def test_reduction_to_the_band_is_better_than_plain_truncation():
    response = theodorsen_response()
    rom = identify(response, tolerance=1e-4).rom
    n = 3
    plain = response.column_errors(balanced_truncation(rom, n).rom.transfer(1j * OMEGA)).max()
    fitted = response.column_errors(reduce_to_band(rom, response, n_lags=n).transfer(1j * OMEGA)).max()
    assert fitted < plain


def records(rom, end=60.0, step=0.02):
    """Return loads after a unit step of velocity, by the matrix exponential."""
    import scipy.linalg as sl

    t = np.arange(0.0, end + step / 2, step)
    transition, states = sl.expm(rom.lag_state * step), [rom.lag_input]
    for _ in t[1:]:
        states.append(transition @ states[-1])
    return t, rom.stiffness * t[:, None, None] + rom.damping + rom.lag_output @ np.array(states)


def test_realisation_finds_a_linear_system_exactly_from_its_records():
    rom = rom_of(known_fit())
    t, loads = records(rom)
    found = realise(t, loads, n_lags=rom.n_lags, mass=rom.mass, stiffness=rom.stiffness, damping=rom.damping)
    s = 1j * np.geomspace(0.1, 50.0, 20)
    assert found.error < 1e-10
    assert found.dropped == 0
    np.testing.assert_allclose(found.rom.transfer(s), rom.transfer(s), rtol=1e-8, atol=1e-8)


def test_realisation_separates_the_quasi_steady_part_itself():
    rom = rom_of(known_fit())
    t, loads = records(rom, end=120.0)
    found = realise(t, loads, n_lags=rom.n_lags, mass=rom.mass)
    # what is left of the slowest transient, exp(-.1 t), in the last quarter of the record
    remainder = np.exp(-0.1 * 90.0) * np.abs(loads - rom.stiffness * t[:, None, None]).max()
    assert np.abs(found.rom.stiffness - rom.stiffness).max() < remainder
    assert np.abs(found.rom.damping - rom.damping).max() < 100 * remainder


def test_realisation_drops_what_is_not_stable():
    rom = rom_of(known_fit())
    t, loads = records(rom)
    noise = np.random.default_rng(0).normal(size=loads.shape) * 1e-3
    found = realise(t, loads + noise, n_lags=40, mass=rom.mass, stiffness=rom.stiffness, damping=rom.damping)
    assert found.rom.poles.real.max() < 0.0


def test_a_short_record_is_warned_of():
    rom = rom_of(known_fit())
    t, loads = records(rom, end=4.0)
    with pytest.warns(ShortRecordWarning, match="second half"):
        realise(t, loads, n_lags=6, mass=rom.mass, stiffness=rom.stiffness)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t, y: (t**1.1, y), "uniform"),
        (lambda t, y: (t + 1.0, y), "start at 0"),
        (lambda t, y: (t[:5], y[:5]), "at least 8"),
        (
            lambda t, y: (t, np.where(t[:, None, None] == t[3], np.nan, y)),
            r"loads\[3, 0, 0\] is nan; all values must",
        ),
        (lambda t, y: (t, y[:-1]), "do not fit"),
    ],
)
def test_bad_records_are_refused(change, message):
    rom = rom_of(known_fit())
    t, loads = change(*records(rom, end=4.0))
    with pytest.raises(ValueError, match=message):
        realise(t, loads, n_lags=4, mass=rom.mass, stiffness=rom.stiffness)


def test_a_response_survives_csv_and_npz(tmp_path):
    response = response_of(known_fit())
    response.to_csv(tmp_path / "g.csv")
    response.save(tmp_path / "g.npz")
    for back in (FrequencyResponse.from_csv(tmp_path / "g.csv"), FrequencyResponse.load(tmp_path / "g.npz")):
        for name in ("omega", "values", "static", "base_load"):
            assert np.array_equal(getattr(back, name), getattr(response, name))


def test_rows_and_columns_have_names():
    response = response_of(known_fit()).truncated(0)
    assert response.load_names == ["C_L"]
    assert response.motion_names == ["alpha", "z"]
    assert response.values.shape[1:] == (len(response.load_names), len(response.motion_names))


def test_a_table_with_a_missing_entry_is_refused(tmp_path):
    response_of(known_fit()).to_csv(tmp_path / "g.csv")
    lines = (tmp_path / "g.csv").read_text().splitlines()
    (tmp_path / "g.csv").write_text("\n".join(lines[:-1]))
    with pytest.raises(ValueError, match="exactly once"):
        FrequencyResponse.from_csv(tmp_path / "g.csv")


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("0.0,0,0,abc,0.0", r"line 3, column 'real': 'abc'; a finite number is needed"),
        ("0.0,C_L,0,1.0,0.0", r"line 3, column 'load': 'C_L'; a whole number is needed: C_L is 0, dCp_1 is 1"),
        ("0.0,0,1.5,1.0,0.0", r"line 3, column 'motion': '1.5'; a whole number is needed: alpha is 0"),
        ("0.0,-1,0,1.0,0.0", r"line 3, column 'load': '-1'; a whole number"),
        ("-0.1,0,0,1.0,0.0", r"line 3, column 'omega': '-0.1'; a finite number is needed, not negative"),
        ("0.0,0,0,1.0,NaN", r"line 3, column 'imag': 'NaN'; a finite number is needed"),
        ("0.0,0,0,1.0,0.0,9", r"line 3: \['0.0', '0', '0', '1.0', '0.0', '9'\] are 6 columns; \('omega', 'load'"),
    ],
)
def test_a_cell_that_is_no_number_is_named(row, message, tmp_path):
    response_of(known_fit()).to_csv(tmp_path / "g.csv")
    lines = (tmp_path / "g.csv").read_text().splitlines()
    (tmp_path / "g.csv").write_text("\n".join([*lines[:2], row, *lines[3:]]))
    with pytest.raises(ValueError, match=message):
        FrequencyResponse.from_csv(tmp_path / "g.csv")


def test_a_table_with_an_entry_twice_is_refused(tmp_path):
    response_of(known_fit()).to_csv(tmp_path / "g.csv")
    lines = (tmp_path / "g.csv").read_text().splitlines()
    (tmp_path / "g.csv").write_text("\n".join([*lines, lines[-1]]))
    with pytest.raises(ValueError, match="exactly once"):
        FrequencyResponse.from_csv(tmp_path / "g.csv")


def test_bad_responses_are_refused():
    good = response_of(known_fit())
    facts = {"omega": good.omega, "values": good.values, "static": good.static, "base_load": good.base_load}
    for change, message in (
        ({"omega": good.omega[::-1]}, "rising"),
        ({"values": good.values[:, :, :-1]}, "shape"),
        ({"static": good.static * np.nan}, r"static\[0, 0\] is nan; all values must be finite"),
    ):
        with pytest.raises(ValueError, match=message):
            FrequencyResponse(**(facts | change))
    with pytest.raises(ValueError, match=rf"n_modes is 9; give an integer from 0 to {good.n_modes}: the response has"):
        good.truncated(9)
    with pytest.raises(ValueError, match="no frequency"):
        good.band(1e4, 1e5)


def test_the_report_has_a_picture():
    import matplotlib as mpl

    mpl.use("Agg")
    found = identify(theodorsen_response(n_modes=1), tolerance=1e-2)
    figure = found.plot()
    assert len(figure.axes) == 9
    assert "relative error" in repr(found)
