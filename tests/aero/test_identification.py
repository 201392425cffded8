"""Identification: known rational functions are found exactly, the rest as well as the theory says."""

import dataclasses
import os
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
from hbnlp.core.errors import LoadError

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
    assert found.n_poles == 3
    assert exact.column_errors(found.rom.transfer(1j * OMEGA)).max() < 0.015
    (record,) = caplog.records
    assert re.search(
        rf"the error is {found.error:.2e} with 3 poles, .* up to 40 poles only fit the noise, some 2.0e-02: set toler",
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
            r"loads\[3, 0, 0\] is nan; give an array of finite",
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
    with pytest.raises(LoadError, match=r"no row for omega .*, load 2, motion 3; add it"):
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
    with pytest.raises(LoadError, match=message):
        FrequencyResponse.from_csv(tmp_path / "g.csv")


def test_a_table_with_an_entry_twice_is_refused(tmp_path):
    response_of(known_fit()).to_csv(tmp_path / "g.csv")
    lines = (tmp_path / "g.csv").read_text().splitlines()
    (tmp_path / "g.csv").write_text("\n".join([*lines, lines[-1]]))
    with pytest.raises(LoadError, match=rf"line {len(lines) + 1}: the entry stands in line {len(lines)} already"):
        FrequencyResponse.from_csv(tmp_path / "g.csv")


TABLES = {
    "empty": (b"", r"line 1: the header is \(\)"),
    "an archive": (b"PK\x03\x04\xff\xfe\x00", r"not a readable frequency table .*utf-8"),
    "a field without an end": (b'omega,load,motion,real,imag\n0,0,0,1,"' + 200_000 * b"1", "field larger than"),
    "a header alone": (b"omega,load,motion,real,imag\n", "no rows with omega 0; add the static value"),
    "no static value": (b"omega,load,motion,real,imag\n1,0,0,1,0\n1,0,1,1,0\n", "no rows with omega 0"),
    "a static value alone": (b"omega,load,motion,real,imag\n0,0,0,1,0\n0,0,1,1,0\n", "with omega 0 and others are"),
    "too few motions": (b"omega,load,motion,real,imag\n0,0,0,1,0\n1,0,0,1,0\n", "1 loads of 1 motions"),
    "a complex static value": (
        b"omega,load,motion,real,imag\n0,0,0,1,0\n0,0,1,1,0.5\n1,0,0,1,0\n1,0,1,1,0\n",
        r"line 3, column 'imag': 0\.5; the static value is real",
    ),
    "a bomb": (b"omega,load,motion,real,imag\n0,1000000000,1000000001,1,0\n1,0,0,1,0\n", "no row for omega 0, load 0"),
}


@pytest.mark.parametrize(("content", "message"), TABLES.values(), ids=TABLES)
def test_what_is_no_table_is_one_error_that_names_it(content, message, tmp_path):
    (tmp_path / "g.csv").write_bytes(content)
    with pytest.raises(LoadError, match=rf"g\.csv.*{message}"):
        FrequencyResponse.from_csv(tmp_path / "g.csv")


def test_a_folder_or_a_pipe_is_no_table(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    for path, kind in ((tmp_path, "a folder"), (tmp_path / "pipe.csv", "a pipe")):
        with pytest.raises(LoadError, match=f"that is {kind}"):
            FrequencyResponse.from_csv(path)
    with pytest.raises(FileNotFoundError):
        FrequencyResponse.from_csv(tmp_path / "none.csv")


def test_a_table_of_a_spreadsheet_is_read(tmp_path):
    response = response_of(known_fit())
    response.to_csv(tmp_path / "g.csv")
    (tmp_path / "g.csv").write_bytes(b"\xef\xbb\xbf" + (tmp_path / "g.csv").read_bytes() + b"\r\n\r\n")
    assert np.array_equal(FrequencyResponse.from_csv(tmp_path / "g.csv").values, response.values)


def test_bad_responses_are_refused():
    good = response_of(known_fit())
    facts = {"omega": good.omega, "values": good.values, "static": good.static, "base_load": good.base_load}
    for change, message in (
        ({"omega": good.omega[::-1]}, "rising"),
        ({"values": good.values[:, :, :-1]}, "shape"),
        ({"static": good.static * np.nan}, r"static\[0, 0\] is nan; give an array of finite"),
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


def random_rational(seed, n_frequencies=60):
    """Return a response and its poles: 0 to 8 poles, 0 to 5 modes, 2 to 5 decades, even, logarithmic or no spacing."""
    rng = np.random.default_rng(seed)
    shape = (rows := int(rng.integers(1, 7)), rows + 1)
    lowest = 10.0 ** rng.uniform(-3.0, 0.0)
    highest = lowest * 10.0 ** rng.uniform(2.0, 5.0)
    omega = [
        np.geomspace(lowest, highest, n_frequencies),
        np.linspace(lowest, highest, n_frequencies),
        np.sort(np.geomspace(lowest, highest, 10**4)[rng.choice(10**4, n_frequencies, replace=False)]),
    ][rng.integers(3)]
    poles, residues = [], []
    for _ in range(rng.integers(0, 5)):
        size = np.exp(rng.uniform(np.log(2.0 * omega[0]), np.log(0.5 * omega[-1])))
        residue = rng.normal(size=shape) + 1j * rng.normal(size=shape)
        if rng.random() < 0.4:
            residue = np.outer(residue[:, 0], residue[0])
        ratio = rng.uniform(0.15, 1.85)
        if ratio < 1.0:
            pole = size * (-ratio + 1j * np.sqrt(1.0 - ratio**2))
            poles += [pole, pole.conjugate()]
            residues += [residue, residue.conj()]
        else:
            poles.append(complex(-size))
            residues.append(residue.real.astype(complex))
    k, d, m = rng.normal(size=(3, *shape))
    fit = PoleFit(
        poles=np.array(poles, dtype=complex), residues=np.array(residues, dtype=complex).reshape(-1, *shape),
        stiffness=k, damping=d, mass=m / omega[-1] ** rng.uniform(),
    )  # fmt: skip
    return response_of(fit, omega), fit


def own_error(rom, response):
    """Return the largest error of a column by the matrices themselves, and check that the record says the same."""
    s = 1j * response.omega[:, None, None]
    states = np.linalg.solve(s * np.eye(rom.n_lags) - rom.lag_state, s**2 * rom.lag_input)
    loads = rom.stiffness + s * rom.damping + s**2 * rom.mass + rom.lag_output @ states
    error = np.max(np.linalg.norm(loads - response.values, axis=1) / response.column_sizes)
    assert rom.provenance.fit_error == pytest.approx(error, rel=1e-6, abs=1e-11)
    return error


@pytest.mark.parametrize("seed", range(20))
def test_rational_data_give_their_own_poles_and_ranks_and_no_others(seed):
    response, truth = random_rational(seed)
    found = identify(response)
    assert own_error(found.rom, response) < 1e-8
    assert found.error == pytest.approx(found.rom.provenance.fit_error, abs=1e-15)
    assert found.n_poles == truth.poles.size
    ranks = sum(np.linalg.matrix_rank(residue, tol=1e-9) for residue in truth.residues)
    assert found.rom.n_lags == ranks
    for pole in truth.poles:
        assert np.abs(found.rom.poles - pole).min() < 1e-6 * abs(pole)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["noise", "unstable", "delay", "reduced"])
def test_the_stated_error_is_that_of_the_rom_that_is_returned(kind, seed, caplog):
    """Whatever the data, and never more than the log says."""
    response, _ = random_rational(100 + seed, n_frequencies=30)
    values, rng, n_lags = response.values, np.random.default_rng(seed), None
    if kind == "noise":
        values = values * (1.0 + [1e-3, 0.01, 0.03, 0.05][seed] * rng.normal(size=values.shape))
    elif kind == "unstable":
        pole, s = 0.3 * response.omega[15], 1j * response.omega[:, None, None]
        values = values + s**2 / (s - pole)
    elif kind == "delay":
        values = values * np.exp(-2j * response.omega / response.omega[-1])[:, None, None]
    else:
        n_lags = 2
    response = dataclasses.replace(response, values=values)
    found = identify(response, n_lags=n_lags, most_poles=16)
    error = own_error(found.rom, response)
    if error > 5e-3:
        assert n_lags or f"the error is {error:.2e}" in caplog.text
    # no lag state far from the band, where it would be a part of D and M
    assert np.all(np.abs(found.rom.poles) < 1.001e3 * response.omega[-1])
    assert np.all(np.abs(found.rom.poles) > 0.999e-3 * response.omega[0])


def rational(poles=(-0.1, -1.0, -6.0), sizes=(1.0, 0.5, 0.2)):
    s = 1j * OMEGA
    values = 1.0 + 0.2 * s + s**2 * sum(size / (s - pole) for pole, size in zip(poles, sizes, strict=True))
    return FrequencyResponse(
        omega=OMEGA, values=np.stack([values, 2.0 * values], axis=-1)[:, None, :], static=np.array([[1.0, 2.0]]),
        base_load=np.zeros(1),
    )  # fmt: skip


def test_a_lag_is_not_dropped_because_another_is_larger():
    """Residues 1e6 apart, the small one at the frequency where it is seen."""
    response = rational(poles=(-0.02, -80.0), sizes=(1.0, 1e6))
    found = identify(response, tolerance=1e-9)
    assert found.rom.poles == pytest.approx([-0.02, -80.0], rel=1e-6)
    assert own_error(found.rom, response) < 1e-9


@pytest.mark.parametrize("n_lags", [None, 2])
def test_a_motion_without_load_has_columns_of_zeros(n_lags):
    response = rational()
    response = dataclasses.replace(
        response, values=response.values * np.array([1.0, 0.0]), static=response.static * np.array([1.0, 0.0])
    )
    found = identify(response, n_lags=n_lags)
    assert own_error(found.rom, response) < (1e-12 if n_lags is None else 0.04)
    assert np.abs(found.rom.transfer(1j * OMEGA)[:, :, 1]).max() < 1e-12
    if n_lags is None:
        assert found.rom.poles == pytest.approx([-0.1, -1.0, -6.0], rel=1e-8)
    with pytest.raises(ValueError, match=r"damping\[1\] is \[-1.\], but the response to z is zero"):
        identify(response, damping={1: np.array([-1.0])})


def test_a_load_without_motion_has_rows_of_zeros():
    response, _ = random_rational(9)
    keep = np.ones((response.n_modes + 1, 1))
    keep[-1] = 0.0
    response = dataclasses.replace(response, values=response.values * keep, static=response.static * keep)
    found = identify(response)
    assert own_error(found.rom, response) < 1e-8
    assert np.abs(found.rom.transfer(1j * response.omega)[:, -1]).max() < 1e-9


@pytest.mark.parametrize("n_lags", [None, 0, 3])
def test_quasi_steady_and_zero_data_have_no_lags(n_lags):
    s = 1j * OMEGA
    for values in (1.0 + 0.2 * s + 3.0 * s**2, 1.0 + 0.0 * s, 0.0 * s):
        response = dataclasses.replace(
            rational(), values=np.stack([values, values], axis=-1)[:, None, :], static=np.full((1, 2), values[0].real)
        )
        if values[0].imag:
            response = dataclasses.replace(response, static=np.ones((1, 2)))
        found = identify(response, n_lags=n_lags)
        assert found.rom.n_lags == found.n_poles == 0
        assert own_error(found.rom, response) < 1e-12


@pytest.mark.parametrize("index", [0, 30, 59])
def test_a_column_that_vanishes_at_one_frequency_is_measured_by_its_surroundings(index):
    response = rational()
    values = response.values.copy()
    values[index, :, 0] *= 1e-9
    dip = dataclasses.replace(response, values=values)
    assert dip.column_sizes[index, 0] == pytest.approx(0.1 * abs(response.values[index, 0, 0]), rel=0.5)
    untouched = np.delete(np.arange(60), index)
    np.testing.assert_array_equal(dip.column_sizes[untouched], response.column_sizes[untouched])
    np.testing.assert_allclose(response.column_sizes, np.abs(response.values[:, 0]), rtol=1e-14)
    own_error(identify(dip).rom, dip)


def test_two_frequencies_are_too_few():
    response = rational()
    with pytest.raises(ValueError, match="2 frequencies and most_poles 40 are too few"):
        identify(dataclasses.replace(response, omega=OMEGA[:2], values=response.values[:2]))
