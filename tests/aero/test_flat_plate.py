"""The shipped ROM at Re = 100: against its data, theory at both ends of the band, and on the wing."""

import numpy as np
import pytest

from hbnlp.aero.flat_plate import flat_plate_re100, flat_plate_re100_response

# inviscid added mass, dCp_j = -M_jk W_k'', as test_thin_airfoil.py has it; row, column of the response -> M
ADDED_MASS = {(1, 2): 1.709261, (2, 3): 0.718468, (3, 4): 0.471274}
MASS_RATIO = 0.5


@pytest.fixture(scope="module")
def response():
    return flat_plate_re100_response()


def wing_matrix(rom, c_T, mu=MASS_RATIO):
    """Return the state matrix of (W, W', x): (2 mu - M) W'' - D W' + (k^2 pi^2 c_T - K) W = C x, x' = A x + B W''."""
    n, lags = rom.n_modes, rom.n_lags
    k = np.arange(1, n + 1)
    mass = 2.0 * mu * np.eye(n) - rom.mass[1:, 2:]
    stiffness = np.diag(k**2 * np.pi**2 * c_T) - rom.stiffness[1:, 2:]
    acceleration = np.linalg.solve(mass, np.hstack([-stiffness, rom.damping[1:, 2:], rom.lag_output[1:]]))
    drive = rom.lag_input[:, 2:]
    top = np.hstack([np.zeros((n, n)), np.eye(n), np.zeros((n, lags))])
    lag = np.hstack([np.zeros((lags, 2 * n)), rom.lag_state]) + drive @ acceleration
    return np.vstack([top, acceleration, lag])


def lift_response(rom, c_T, omega):
    """Return |C_L| per pitch acceleration of the wing with small deflection."""
    n = rom.n_modes
    k = np.arange(1, n + 1)
    inertia = 2.0 * MASS_RATIO * 2.0 * (-1.0) ** (k + 1) / (k * np.pi)
    g = rom.transfer(1j * omega)
    gain = []
    for w, at in zip(omega, g, strict=True):
        dynamic = np.diag(k**2 * np.pi**2 * c_T - 2.0 * MASS_RATIO * w**2) - at[1:, 2:]
        amplitude = np.linalg.solve(dynamic, at[1:, 0] - w**2 * inertia)
        gain.append(abs(at[0, 0] + at[0, 2:] @ amplitude) / w**2)
    return np.array(gain)


@pytest.mark.parametrize(("full", "tolerance"), [(False, 0.02), (True, 0.005)])
@pytest.mark.parametrize("n_modes", [1, 3, 5, 10, 15, 20])
def test_every_column_is_fitted_over_the_band(response, n_modes, full, tolerance):
    computed = response.truncated(n_modes)
    rom = flat_plate_re100(n_modes, full=full)
    assert rom.provenance.band == (computed.omega[0], computed.omega[-1]) == (0.01, 1000.0)
    assert computed.column_errors(rom.transfer(1j * computed.omega)).max() < 1.01 * rom.provenance.fit_error < tolerance


def test_the_response_is_converged_over_the_band(response):
    """By order, mesh and domain, all columns: the three together are below the 0.2 % asked for."""
    estimates = response.provenance["error_estimates"]
    assert set(estimates) == {"order", "mesh", "domain"}
    probes = [omega for omega in estimates["order"] if 0.029 < float(omega) < 100.0]
    assert len(probes) == 5
    assert max(sum(of[omega] for of in estimates.values()) for omega in probes) < 2e-3


def test_the_default_has_at_most_sixty_lag_states_for_ten_modes():
    assert flat_plate_re100().n_lags <= 60
    assert flat_plate_re100(20).n_lags <= 120
    assert flat_plate_re100(full=True).n_lags > 60


@pytest.mark.parametrize("full", [False, True])
def test_static_heave_is_null_and_slow_heave_is_minus_pitch(response, full):
    rom = flat_plate_re100(full=full)
    assert np.array_equal(rom.stiffness[:, 1], np.zeros(11))
    expected = -rom.stiffness[:, 0]
    expected[0] -= response.provenance["drag"]
    np.testing.assert_allclose(rom.damping[:, 1], expected, rtol=1e-12)


def test_the_raw_response_has_the_null_static_heave_of_theory(response):
    assert np.array_equal(response.static[:, 1], np.zeros(21))
    # what the discretisation had left, relative to the load per pitch
    assert response.provenance["static_heave_taken_off"] < 1e-4 * np.abs(response.static[:, 0]).max()


def test_the_drag_is_near_the_triple_deck(response):
    # Blasius' plate on both sides, the triple deck at its end (A. F. Messiter, SIAM J. Appl. Math. 18 (1970) 241-257),
    # its factor by D. A. Jobe, O. R. Burggraf, Proc. R. Soc. Lond. A 340 (1974) 91-111, and later work
    triple_deck = 2.0 * (1.328 * 100.0**-0.5 + 2.67 * 100.0 ** (-7.0 / 8.0))
    assert response.provenance["drag"] == pytest.approx(triple_deck, rel=0.02)


def test_the_added_mass_tends_to_the_inviscid_one(response):
    """Extrapolated in 1/sqrt(omega), by which Stokes layers go, from 200 to 1000."""
    high = response.omega >= 200.0
    root = response.omega[high] ** -0.5
    for (row, column), inviscid in ADDED_MASS.items():
        mass = -(response.values[high, row, column] / (1j * response.omega[high]) ** 2).real
        assert np.polyfit(root, mass, 1)[1] == pytest.approx(inviscid, rel=0.01)


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("n_modes", [1, 3, 5, 10, 15, 20])
def test_the_added_mass_of_the_membrane_is_positive(n_modes, full):
    block = -flat_plate_re100(n_modes, full=full).mass[1:, 2:]
    assert np.linalg.eigvalsh(0.5 * (block + block.T)).min() > 0.0


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("n_modes", [3, 5, 10, 15, 20])
def test_the_wing_is_linearly_stable(n_modes, full):
    rom = flat_plate_re100(n_modes, full=full)
    for c_T in (0.5, 0.7, 1.0, 2.0, 4.0, 20.0, 100.0, 400.0):
        assert np.linalg.eigvals(wing_matrix(rom, c_T)).real.max() < 0.0


@pytest.mark.parametrize("full", [False, True])
def test_one_mode_alone_diverges_at_low_tension(full):
    """Where its static stiffness vanishes, at c_T = K_11/pi^2 = 0.507; more modes are stable there."""
    rom = flat_plate_re100(1, full=full)
    limit = rom.stiffness[1, 2] / np.pi**2
    assert limit == pytest.approx(0.507, abs=5e-4)
    for c_T in (1.01 * limit, 1.0, 20.0, 400.0):
        assert np.linalg.eigvals(wing_matrix(rom, c_T)).real.max() < 0.0
    assert np.linalg.eigvals(wing_matrix(rom, 0.99 * limit)).real.max() > 0.0


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("c_T", [1.0, 10.0, 100.0, 400.0])
def test_high_modes_are_damped_beyond_the_band(c_T, full):
    """No mode is driven by an artefact of the fit, up to those whose frequency is above a thousand."""
    values = np.linalg.eigvals(wing_matrix(flat_plate_re100(20, full=full), c_T))
    fast = values[np.abs(values.imag) > 20.0]
    assert fast.size
    assert (fast.real / np.abs(fast)).max() < 0.0


def test_the_first_lift_resonance_rises_with_tension():
    """Per pitch; per pitch acceleration the strongly damped resonance at c_T = 1 is but a shoulder."""
    omega = np.geomspace(0.5, 8.0, 400)
    rom = flat_plate_re100()
    peaks = []
    for c_T in (1.0, 1.5, 2.0, 3.0, 4.0):
        lift = lift_response(rom, c_T, omega) * omega**2
        peaks.append(omega[np.flatnonzero((lift[1:-1] > lift[:-2]) & (lift[1:-1] > lift[2:]))[0] + 1])
    assert np.all(np.diff(peaks) > 0.2)
    # near the frequency in vacuo with the added mass, pi sqrt(c_T/(1 + 1.7)), at high tension
    assert peaks[-1] == pytest.approx(np.pi * np.sqrt(4.0 / 2.709), rel=0.1)


def test_the_number_of_modes_is_checked():
    with pytest.raises(ValueError, match="21"):
        flat_plate_re100(21)


def test_it_loads_in_milliseconds():
    import time

    flat_plate_re100()
    start = time.perf_counter()
    flat_plate_re100(5)
    assert time.perf_counter() - start < 0.2
