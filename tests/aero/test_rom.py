"""The ROM record: its transfer function, its truncation, its files, and what it refuses."""

import copy
import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from hbnlp.aero import AeroROM, Provenance, flat_plate_re100, thin_airfoil
from hbnlp.core.errors import OutsideBandWarning
from hbnlp.core.storage import save_arrays

quick = settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])

# random ROMs have random bands
of_any_band = pytest.mark.filterwarnings("ignore::hbnlp.core.errors.OutsideBandWarning")


def random_arrays(n_modes, n_lags, seed):
    rng = np.random.default_rng(seed)
    shape = (n_modes + 1, n_modes + 2)
    a = rng.normal(size=(n_lags, n_lags))
    if n_lags:
        a -= (0.1 + np.linalg.eigvals(a).real.max()) * np.eye(n_lags)
    return {
        "stiffness": rng.normal(size=shape),
        "damping": rng.normal(size=shape),
        "mass": rng.normal(size=shape),
        "lag_state": a,
        "lag_input": rng.normal(size=(n_lags, n_modes + 2)),
        "lag_output": rng.normal(size=(n_modes + 1, n_lags)),
        "base_motion": rng.normal(size=n_modes + 2),
        "base_load": rng.normal(size=n_modes + 1),
    }


provenances = st.builds(
    Provenance,
    source=st.text(max_size=20),
    reynolds=st.none() | st.floats(1.0, 1e6),
    incidence=st.floats(-1.0, 1.0),
    band=st.none() | st.floats(0.0, 1.0).map(lambda low: (low, low + 2.0)),
    fit_error=st.none() | st.floats(0.0, 1.0),
)
roms = st.builds(
    lambda n_modes, n_lags, seed, provenance: AeroROM(**random_arrays(n_modes, n_lags, seed), provenance=provenance),
    st.integers(0, 4),
    st.integers(0, 5),
    st.integers(0, 2**31),
    provenances,
)


def valid(**changes):
    return random_arrays(2, 3, 1) | changes


def test_transfer_function_of_one_lag_is_its_formula():
    rom = AeroROM(
        stiffness=[[1.0, 2.0]],
        damping=[[3.0, 4.0]],
        mass=[[5.0, 6.0]],
        lag_state=[[-7.0]],
        lag_input=[[8.0, 9.0]],
        lag_output=[[10.0]],
    )
    s = 0.3 + 0.4j
    lag = 10.0 * s**2 / (s + 7.0)
    expected = [[1.0 + 3.0 * s + 5.0 * s**2 + 8.0 * lag, 2.0 + 4.0 * s + 6.0 * s**2 + 9.0 * lag]]
    np.testing.assert_allclose(rom.transfer(s), expected, rtol=1e-14)


@of_any_band
@quick
@given(rom=roms)
def test_static_transfer_is_the_stiffness_exactly_and_fast_motion_meets_the_mass(rom):
    np.testing.assert_array_equal(rom.transfer(0.0), rom.stiffness)
    fast = 1e9j
    np.testing.assert_allclose(rom.transfer(fast) / fast**2, rom.mass, atol=1e-6)


@of_any_band
@quick
@given(rom=roms, omega=st.floats(0.01, 100.0))
def test_real_motion_has_real_loads(rom, omega):
    np.testing.assert_allclose(rom.transfer(-1j * omega), np.conj(rom.transfer(1j * omega)), rtol=1e-10, atol=1e-10)


@of_any_band
@quick
@given(rom=roms)
def test_transfer_of_an_array_stacks_that_of_its_points(rom):
    s = np.array([[0.0, 1j, 2j], [0.5, 1.0 + 1j, 3j]])
    g = rom.transfer(s)
    assert g.shape == (2, 3, rom.n_modes + 1, rom.n_modes + 2)
    for i in np.ndindex(s.shape):
        np.testing.assert_allclose(g[i], rom.transfer(s[i]), rtol=1e-12)


def test_transfer_function_agrees_with_the_loads_integrated_in_time():
    # alpha = t^3: u'' = 6 t, and x' = A x + B u'' is solved by the exact exponential of the augmented system
    rom = AeroROM(**(random_arrays(1, 2, 4) | {"base_motion": np.zeros(3), "base_load": np.zeros(2)}))
    t, n = 0.7, 2
    big = np.zeros((n + 2, n + 2))
    big[:n, :n] = rom.lag_state
    big[:n, n] = 6.0 * rom.lag_input[:, 0]
    big[n, n + 1] = 1.0
    x = expm(big * t)[:n, -1]
    load = rom.stiffness[:, 0] * t**3 + rom.damping[:, 0] * 3 * t**2 + rom.mass[:, 0] * 6 * t + rom.lag_output @ x
    # inverse Laplace transform of G(s) 6/s^4 by the trapezoidal rule on Talbot's contour
    theta = (np.arange(32) + 0.5) * 2 * np.pi / 32 - np.pi
    z = 32 / t * (-0.6122 + 0.5017 * theta / np.tan(0.6407 * theta) + 0.2645j * theta)
    dz = 32 / t * (0.5017 / np.tan(0.6407 * theta) - 0.5017 * 0.6407 * theta / np.sin(0.6407 * theta) ** 2 + 0.2645j)
    values = rom.transfer(z)[:, :, 0] * (6 / z**4 * np.exp(z * t) * dz)[:, np.newaxis]
    np.testing.assert_allclose(np.sum(values, axis=0).imag / 32, load, rtol=1e-9)


@quick
@given(rom=roms, data=st.data())
def test_truncation_is_the_leading_block_of_the_transfer_function(rom, data):
    m = data.draw(st.integers(0, rom.n_modes))
    small = rom.truncated(m)
    np.testing.assert_allclose(small.transfer(1j), rom.transfer(1j)[: m + 1, : m + 2], rtol=1e-12)
    np.testing.assert_array_equal(small.base_motion, rom.base_motion[: m + 2])
    np.testing.assert_array_equal(small.base_load, rom.base_load[: m + 1])
    assert small.provenance == rom.provenance
    assert rom.truncated(rom.n_modes) == rom


@pytest.mark.parametrize("n_modes", [3, -1, 1.5, True])
def test_truncation_to_modes_that_are_not_there_is_refused(n_modes):
    with pytest.raises(ValueError, match=rf"n_modes is {n_modes}.*from 0 to 2.*has 2 modes"):
        AeroROM(**valid()).truncated(n_modes)


@quick
@given(rom=roms)
def test_save_and_load_are_inverse(tmp_path, rom):
    path = tmp_path / "any name"
    rom.save(path)
    assert list(tmp_path.iterdir()) == [path]
    assert AeroROM.load(path) == rom


def test_loading_needs_no_pickle_and_metadata_are_json(tmp_path):
    rom = thin_airfoil(2)
    rom.save(tmp_path / "rom.npz")
    with np.load(tmp_path / "rom.npz", allow_pickle=False) as archive:
        metadata = json.loads(archive["metadata.json"].tobytes())
        np.testing.assert_array_equal(archive["stiffness"], rom.stiffness)
    assert metadata["kind"] == "AeroROM"
    assert metadata["provenance"]["source"] == rom.provenance.source


def test_loading_validates(tmp_path):
    path = tmp_path / "rom.npz"
    arrays = {name: np.asarray(value) for name, value in valid().items()}
    save_arrays(path, "AeroROM", arrays, {"provenance": {"colour": "blue"}})
    with pytest.raises(ValueError, match="colour"):
        AeroROM.load(path)
    del arrays["mass"]
    save_arrays(path, "AeroROM", arrays, {"provenance": {}})
    with pytest.raises(ValueError, match="mass"):
        AeroROM.load(path)
    save_arrays(path, "AeroROM", arrays | {"mass": np.full((3, 4), np.nan)}, {"provenance": {}})
    with pytest.raises(ValueError, match="its mass has values that are not finite"):
        AeroROM.load(path)


@quick
@given(rom=roms)
def test_statespace_round_trip_is_exact(rom):
    pytest.importorskip("control")
    assert AeroROM.from_statespace(rom.to_statespace()) == rom


def test_a_changed_statespace_has_no_provenance_but_its_name():
    control = pytest.importorskip("control")
    about = Provenance(source="theory", reynolds=100.0, band=(0.1, 60.0), fit_error=0.01)
    rom = AeroROM(**valid(), provenance=about)
    system = rom.to_statespace()
    assert AeroROM.from_statespace(copy.deepcopy(system)) == rom
    other = Provenance(source="mine")
    assert AeroROM.from_statespace(system, provenance=other).provenance == other
    again = control.ss(system.A, system.B, system.C, system.D, name="again")
    assert AeroROM.from_statespace(again).provenance == Provenance(source="control.StateSpace 'again'")
    system.D = 2.0 * system.D
    assert AeroROM.from_statespace(system).provenance == Provenance(source="control.StateSpace 'AeroROM'")


def test_statespace_is_the_transfer_function_from_accelerations():
    control = pytest.importorskip("control")
    rom = AeroROM(**valid())
    system = rom.to_statespace()
    assert isinstance(system, control.StateSpace)
    assert system.input_labels == ["alpha_acceleration", "z_acceleration", "W1_acceleration", "W2_acceleration"]
    assert system.output_labels == ["C_L", "dCp1", "dCp2"]
    s = 0.3 + 2j
    np.testing.assert_allclose(system(s), rom.transfer(s) / s**2, rtol=1e-10)


def test_statespace_of_another_form_is_refused():
    control = pytest.importorskip("control")
    rom = AeroROM(**valid())
    system = rom.to_statespace()
    with pytest.raises(ValueError, match="1 inputs, 1 outputs and 1 states; needed are inputs u''"):
        AeroROM.from_statespace(control.ss([[-1.0]], [[1.0]], [[1.0]], [[0.0]]))
    with pytest.raises(ValueError, match="first 8 states are not u and u'"):
        AeroROM.from_statespace(control.ss(system.A - np.eye(11), system.B, system.C, system.D))
    with pytest.raises(ValueError, match=r"sampling time 0\.1"):
        AeroROM.from_statespace(control.ss(system.A, system.B, system.C, system.D, 0.1))
    with pytest.raises(TypeError, match=r"system is .*; give a control.StateSpace"):
        AeroROM.from_statespace(control.tf([1.0], [1.0, 1.0]))


def test_without_control_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(ImportError, match=r"pip install 'hbnlp\[control\]'"):
        AeroROM(**valid()).to_statespace()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stiffness": np.zeros((3, 3))}, r"stiffness has shape \(3, 3\); \(N\+1, N\+2\) is needed"),
        ({"stiffness": np.zeros(3)}, r"stiffness has shape \(3,\)"),
        ({"damping": np.zeros((2, 4))}, r"damping has shape \(2, 4\); \(3, 4\) is needed.*N = 2"),
        ({"mass": np.zeros((3, 3))}, r"mass has shape \(3, 3\); \(3, 4\)"),
        ({"lag_state": -np.ones((3, 2))}, r"lag_state has shape \(3, 2\); \(3, 3\)"),
        ({"lag_state": -1.0}, r"lag_state has shape \(\)"),
        ({"lag_input": np.zeros((3, 3))}, r"lag_input has shape \(3, 3\); \(3, 4\) is needed.*n = 3 lag"),
        ({"lag_output": np.zeros((4, 3))}, r"lag_output has shape \(4, 3\); \(3, 3\)"),
        ({"base_motion": np.zeros(3)}, r"base_motion has shape \(3,\); \(4,\)"),
        ({"base_load": 1.0}, r"base_load has shape \(\); \(3,\)"),
        ({"mass": np.full((3, 4), np.nan)}, r"mass\[0, 0\] is nan; all values must be finite"),
        ({"lag_output": [[0, 0, 0], [0, np.inf, 0], [0, 0, 0]]}, r"lag_output\[1, 1\] is inf"),
        ({"lag_input": np.zeros((3, 4), complex)}, "lag_input is not an array of real numbers"),
        ({"damping": [["a"] * 4] * 3}, "damping is not an array of real numbers"),
        ({"lag_state": np.diag([-1.0, 0.25, -1.0])}, r"lag_state has the eigenvalue 0\.25.*negative real part"),
        ({"lag_state": np.zeros((3, 3))}, "lag_state has the eigenvalue 0"),
    ],
)
def test_bad_arrays_are_refused_with_their_value_and_what_is_accepted(changes, message):
    with pytest.raises(ValueError, match=message):
        AeroROM(**valid(**changes))


def test_unknown_and_missing_names_are_errors():
    with pytest.raises(TypeError, match="lag_outputs"):
        AeroROM(**valid(lag_outputs=1))
    with pytest.raises(TypeError, match=r"provenance is \{'reynolds': 100\}"):
        AeroROM(**valid(), provenance={"reynolds": 100})


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"reynolds": -1.0}, ValueError, r"reynolds is -1\.0; give a finite number greater than 0, or None"),
        ({"reynolds": "high"}, TypeError, "reynolds is 'high'"),
        ({"incidence": np.nan}, ValueError, "incidence is nan"),
        ({"incidence": None}, TypeError, "incidence is None"),
        ({"band": (2.0, 1.0)}, ValueError, r"band is \(2\.0, 1\.0\)"),
        ({"band": (1.0,)}, ValueError, r"band is \(1\.0,\)"),
        ({"fit_error": -0.1}, ValueError, "fit_error"),
        ({"source": 3}, TypeError, "source is 3"),
    ],
)
def test_bad_provenance_is_refused(changes, error, message):
    with pytest.raises(error, match=message):
        Provenance(**changes)


def test_points_where_the_transfer_function_is_not_defined_are_refused():
    rom = thin_airfoil(1)
    with pytest.raises(ValueError, match=r"s.* is nan; give an array of finite numbers"):
        rom.transfer([1.0, np.nan])
    with pytest.raises(ValueError, match="meets a pole"):
        rom.transfer(rom.poles[1])


def test_empty_lag_states_may_be_given_in_any_empty_shape():
    arrays = valid(lag_state=[], lag_input=[], lag_output=[])
    rom = AeroROM(**arrays)
    assert rom.n_lags == 0
    assert rom.poles.shape == (0,)
    np.testing.assert_allclose(rom.transfer(2.0), rom.stiffness + 2.0 * rom.damping + 4.0 * rom.mass)
    with pytest.raises(ValueError, match=r"lag_input has shape \(3, 4\); \(0, 4\)"):
        AeroROM(**(arrays | {"lag_input": np.zeros((3, 4))}))


def test_a_rom_cannot_be_changed_and_shares_no_memory():
    arrays = valid()
    rom = AeroROM(**arrays)
    with pytest.raises(ValueError, match="read-only"):
        rom.stiffness[0, 0] = 1.0
    with pytest.raises(AttributeError):
        rom.mass = None
    before = rom.mass.copy()
    arrays["mass"][:] = 0.0
    np.testing.assert_array_equal(rom.mass, before)


@quick
@given(rom=roms)
def test_a_copy_without_changes_is_equal_and_shares_no_memory(rom):
    copy = replace(rom)
    assert copy == rom
    assert not np.shares_memory(copy.stiffness, rom.stiffness)


def test_a_copy_with_changes_keeps_the_rest_and_is_checked_again():
    rom = AeroROM(**valid(), provenance=Provenance(reynolds=100.0))
    copy = replace(rom, damping=2.0 * rom.damping, base_load=None)
    np.testing.assert_array_equal(copy.damping, 2.0 * rom.damping)
    np.testing.assert_array_equal(copy.base_load, 0.0)
    assert replace(copy, damping=rom.damping, base_load=rom.base_load) == rom
    with pytest.raises(ValueError, match=r"lag_state has the eigenvalue"):
        replace(rom, lag_state=-rom.lag_state)
    with pytest.raises(ValueError, match=r"lag_output has shape \(3, 3\); \(3, 2\) is needed"):
        replace(rom, lag_state=-np.eye(2), lag_input=np.ones((2, 4)))
    with pytest.raises(TypeError, match="provenance is 'mine'"):
        replace(rom, provenance="mine")
    with pytest.raises(TypeError, match="lags"):
        replace(rom, lags=3)


def test_equality_is_by_value():
    rom = AeroROM(**valid())
    assert rom == AeroROM(**valid())
    assert hash(rom) == hash(AeroROM(**valid()))
    assert rom != AeroROM(**valid(base_load=np.zeros(3)))
    assert rom != AeroROM(**valid(), provenance=Provenance(reynolds=100.0))
    assert rom != rom.truncated(1)
    assert rom != "rom"


def test_repr_states_facts_in_five_lines():
    provenance = Provenance(source="Navier-Stokes\nmore", reynolds=100.0, band=(0.1, 60.0), fit_error=0.012)
    text = repr(AeroROM(**valid(), provenance=provenance))
    assert len(text.splitlines()) <= 5
    for fact in ("2 modes", "3 lag states", "Re = 100", "band 0.1 to 60", "fit error 0.012", "Navier-Stokes"):
        assert fact in text


def test_frequencies_outside_the_fitted_band_are_warned_of():
    rom = flat_plate_re100(n_modes=2)
    assert rom.provenance.band == (0.01, 1000.0)
    # inside, its ends, the static value, and points off the imaginary axis: silence, as warnings are errors here
    rom.transfer(1j * np.array([0.0, 0.01, -3.0, 1000.0]))
    rom.transfer([1e-4, 1e4, 1e-4 + 1e-5j])
    with pytest.warns(OutsideBandWarning, match=r"2 of 3 frequencies, from 0\.002 to 5000, lie outside the band"):
        rom.transfer([0.002j, 1j, -5000j])
    with pytest.warns(OutsideBandWarning, match="identify a ROM from data that reach further") as caught:
        rom.transfer(2000j)
    assert caught[0].filename == __file__
    # not a fit: no band
    thin_airfoil(2).transfer(1e6j)
