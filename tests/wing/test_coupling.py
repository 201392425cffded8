"""The membrane wing: membrane and ROM brought together, against closed forms and independent solutions."""

import pickle
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hbnlp.aero import AeroROM, thin_airfoil
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.balance.sampling import polynomial_degree
from hbnlp.branches.tracing import trace
from hbnlp.fourier import to_complex
from hbnlp.solutions.solving import solve
from hbnlp.systems.linear_stability import eigenvalues
from hbnlp.wing.coupling import membrane_wing
from hbnlp.wing.membrane import LinearMembrane, NonlinearMembrane, QuasiLinearMembrane


def vacuum(n_modes):
    shape = (n_modes + 1, n_modes + 2)
    zero = np.zeros(shape)
    return AeroROM(stiffness=zero, damping=zero, mass=zero, lag_state=[], lag_input=[], lag_output=[])


def viscous_like(n_modes, seed=3):
    """Return a thin-airfoil ROM with further weak lags and a base state, so that no term of the law is missing."""
    rng = np.random.default_rng(seed)
    rom = thin_airfoil(n_modes)
    lags = np.array([[-0.3, 1.0, 0.0], [-1.0, -0.3, 0.0], [0.0, 0.0, -2.0]])
    return replace(
        rom,
        lag_state=np.block([[rom.lag_state, np.zeros((2, 3))], [np.zeros((3, 2)), lags]]),
        lag_input=np.vstack([rom.lag_input, 0.1 * rng.normal(size=(3, n_modes + 2))]),
        lag_output=np.hstack([rom.lag_output, 0.1 * rng.normal(size=(n_modes + 1, 3))]),
        base_motion=0.01 * rng.normal(size=n_modes + 2),
        base_load=0.05 * rng.normal(size=n_modes + 1),
    )


def balanced(wing, at, n_harmonics, n_steps=1):
    """Return balance, unknowns and values after Newton steps from rest."""
    problem = HarmonicBalance(wing, n_harmonics)
    values = problem.values(at)
    x = np.zeros(problem.size)
    for _ in range(n_steps):
        x = x - np.linalg.solve(problem.assembly.jacobian(x, values), problem.assembly.residual(x, values))
    assert np.abs(problem.assembly.residual(x, values)).max() < 1e-11
    return problem, x, values


def outputs_of(problem, x, values):
    names = problem.system.output_names
    return dict(zip(names, problem.output_harmonics(x, values)[0], strict=True))


MOTION = {
    "omega": 1.7,
    "pitch_amplitude": 0.05,
    "pitch_mean": 0.03,
    "heave_amplitude": 0.02,
    "heave_phase": 0.4,
    "pitch_axis": 0.3,
}


# --- against independent solutions


def test_linear_wing_obeys_the_roms_transfer_function_harmonic_by_harmonic():
    n, rom = 4, viscous_like(4)
    membrane = LinearMembrane(mass_ratio=0.6, prestrain=0.008, n_modes=n)
    problem, x, values = balanced(membrane_wing(membrane, rom), MOTION, 2)
    out = outputs_of(problem, x, values)

    k = np.arange(1, n + 1)
    inertia = 2 * 0.6 * np.column_stack([-2 * (-1.0) ** k / (k * np.pi), -2 * (1 - (-1.0) ** k) / (k * np.pi)])
    alpha = np.array([0.03, -0.05j])
    z = 0.3 * alpha + np.array([0.0, 0.02 * (np.sin(0.4) - 1j * np.cos(0.4))])
    for h, s in enumerate((0.0, 1.7j)):
        u = np.array([alpha[h], z[h]])
        g = rom.transfer(s)
        base = rom.base_load - rom.stiffness @ rom.base_motion if h == 0 else np.zeros(n + 1)
        dynamic = np.diag(2 * 0.6 * s**2 + k**2 * np.pi**2 * 4.0) - g[1:, 2:]
        W = np.linalg.solve(dynamic, base[1:] + (g[1:, :2] + s**2 * inertia) @ u)
        lift = base[0] + g[0] @ np.concatenate([u, W])
        np.testing.assert_allclose(to_complex(x.reshape(n, -1))[:, h], W, rtol=0, atol=1e-14)
        assert out["C_L"][h] == pytest.approx(lift, abs=1e-13)
        assert out["alpha"][h] == pytest.approx(alpha[h], abs=1e-15)
        assert out["z"][h] == pytest.approx(z[h], abs=1e-15)
        assert out["alpha_acceleration"][h] == pytest.approx(s**2 * alpha[h], abs=1e-15)
        assert out["W2"][h] == pytest.approx(W[1], abs=1e-14)
        assert out["midchord"][h] == pytest.approx(W[0] - W[2], abs=1e-14)
    assert out["tension"][0] == pytest.approx(4.0, rel=1e-14)
    assert abs(out["C_L"][2]) < 1e-13


@pytest.mark.parametrize("model", [QuasiLinearMembrane, NonlinearMembrane])
def test_nonlinear_wing_agrees_with_time_integration_of_the_law_itself(model):
    n, rom = 2, viscous_like(2)
    membrane = model(mass_ratio=0.8, stiffness=100.0, prestrain=0.02, n_modes=n)
    at = MOTION | {"pitch_amplitude": 0.12, "omega": 1.1}
    problem, x, values = balanced(membrane_wing(membrane, rom), at, 9, n_steps=12)
    out = outputs_of(problem, x, values)
    w = at["omega"]

    k = np.arange(1, n + 1)
    inertia = 2 * 0.8 * np.column_stack([-2 * (-1.0) ** k / (k * np.pi), -2 * (1 - (-1.0) ** k) / (k * np.pi)])
    matrix = 2 * 0.8 * np.eye(n) - rom.mass[1:, 2:]

    def motion(t):
        tau = w * t
        alpha = np.array([0.03 + 0.12 * np.sin(tau), w * 0.12 * np.cos(tau), -(w**2) * 0.12 * np.sin(tau)])
        heave = 0.02 * np.array([np.sin(tau + 0.4), w * np.cos(tau + 0.4), -(w**2) * np.sin(tau + 0.4)])
        return np.stack([alpha, 0.3 * alpha + heave], axis=1)

    def state(t, y):
        W, V, lag = y[:n], y[n : 2 * n], y[2 * n :]
        u, du, ddu = motion(t)
        load = rom.base_load + rom.stiffness @ (np.concatenate([u, W]) - rom.base_motion)
        load = load + rom.damping @ np.concatenate([du, V]) + rom.lag_output @ lag
        without = load[1:] + (rom.mass[1:, :2] + inertia) @ ddu - membrane.restoring_force(W)
        acceleration = np.linalg.solve(matrix, without)
        total = np.concatenate([ddu, acceleration])
        return np.concatenate([V, acceleration, rom.lag_state @ lag + rom.lag_input @ total]), load + rom.mass @ total

    # start on the solution; were it none, or of another system, the flow would leave it within the second period
    s = 1j * w * np.arange(10)
    acceleration = s[:, np.newaxis] ** 2 * np.stack([out[name] for name in ("alpha", "z", "W1", "W2")], axis=1)
    lags = [
        np.linalg.solve(e * np.eye(5) - rom.lag_state, rom.lag_input @ a) for e, a in zip(s, acceleration, strict=True)
    ]
    W = np.array([out["W1"], out["W2"]])
    start = np.concatenate([W.sum(axis=1), (W * s).sum(axis=1), np.sum(lags, axis=0)]).real
    period, n_samples = 2 * np.pi / w, 32
    times = period * (1 + np.arange(n_samples) / n_samples)
    flow = solve_ivp(lambda t, y: state(t, y)[0], (0, times[-1]), start, t_eval=times, rtol=1e-9, atol=1e-12)
    lift = np.array([state(t, y)[1][0] for t, y in zip(times, flow.y.T, strict=True)])
    phases = np.exp(-1j * np.outer(np.arange(4), w * times))
    scale = np.array([1, 2, 2, 2]) / n_samples
    np.testing.assert_allclose(scale * (phases @ lift), out["C_L"][:4], atol=2e-6)
    np.testing.assert_allclose(scale * (phases @ flow.y[0]), out["W1"][:4], atol=2e-7)
    np.testing.assert_allclose(scale * (phases @ membrane.tension(flow.y[:n])), out["tension"][:4], atol=1e-5)
    # the case is nonlinear enough to tell: the tension varies and even harmonics appear
    assert abs(out["tension"][1]) > 0.05
    assert abs(out["C_L"][2]) > 1e-3


def test_eigenvalues_make_the_dynamic_stiffness_singular():
    rom, membrane = viscous_like(5), QuasiLinearMembrane(prestrain=0.01, n_modes=5)
    k = np.arange(1, 6)
    for s in eigenvalues(membrane_wing(membrane, rom)):
        dynamic = np.diag(2 * 0.5 * s**2 + k**2 * np.pi**2 * 5.0) - rom.transfer(s)[1:, 2:]
        singular = np.linalg.svd(dynamic, compute_uv=False)
        assert singular[-1] < 1e-9 * singular[0]


# --- closed forms in vacuum


@pytest.mark.parametrize("omega", [0.5, 2.0, 4.5])
def test_heaving_string_in_vacuum_is_the_wave_equations_solution(omega):
    # ends moved by z: y = z cos(kappa (x - 1/2)) / cos(kappa / 2), kappa = omega sqrt(2 mu / c_T)
    membrane = LinearMembrane(mass_ratio=0.5, prestrain=0.008, n_modes=41)
    wing = membrane_wing(membrane, vacuum(41))
    problem, x, values = balanced(wing, {"omega": omega, "heave_amplitude": 0.1}, 1)
    kappa = omega * np.sqrt(2 * 0.5 / 4.0)
    expected = 0.1 * (1 / np.cos(kappa / 2) - 1)
    assert outputs_of(problem, x, values)["midchord"][1] == pytest.approx(-1j * expected, rel=2e-5)


@pytest.mark.parametrize("axis", [0.0, 0.5, 1.0])
def test_pitching_string_in_vacuum_is_the_wave_equations_solution(axis):
    # ends at alpha x_p and alpha (x_p - 1); any combination of sin(kappa x) and cos(kappa x) solves the wave equation
    membrane = LinearMembrane(mass_ratio=0.5, prestrain=0.008, n_modes=41)
    wing = membrane_wing(membrane, vacuum(41), pitch_axis=axis)
    _, x, _ = balanced(wing, {"omega": 3.0, "pitch_amplitude": 0.1}, 1)
    kappa = 1.5
    left, right = axis, axis - 1
    station = 0.3
    y = left * np.cos(kappa * station) + (right - left * np.cos(kappa)) / np.sin(kappa) * np.sin(kappa * station)
    w = 0.1 * (y - (axis - station))
    found = membrane.displacement(x.reshape(41, 3)[:, 2], [station])[0]
    assert found == pytest.approx(w, abs=2e-6)


def test_static_camber_under_mean_incidence_is_the_sail_equations():
    rom, membrane = thin_airfoil(6), NonlinearMembrane(prestrain=0.006, n_modes=6)
    problem, x, values = balanced(membrane_wing(membrane, rom), {"omega": 1.0, "pitch_mean": 0.1}, 1, n_steps=12)
    W = x.reshape(6, 3)[:, 0]
    load = rom.stiffness @ np.concatenate([[0.1, 0.0], W])
    np.testing.assert_allclose(membrane.restoring_force(W), load[1:], atol=1e-11)
    out = outputs_of(problem, x, values)
    assert out["C_L"][0].real == pytest.approx(load[0], rel=1e-12)
    assert load[0] > 2 * np.pi * 0.1
    assert out["tension"][0].real == pytest.approx(membrane.tension(W), rel=1e-12)


# --- structure


def test_pitch_about_an_axis_is_pitch_about_the_leading_edge_with_heave():
    membrane, rom = QuasiLinearMembrane(n_modes=3), thin_airfoil(3)
    about = membrane_wing(membrane, rom, pitch_axis=0.4)
    with_heave = membrane_wing(membrane, rom)
    values = about.parameters.values({"omega": 2.0, "pitch_amplitude": 0.1})
    other = with_heave.parameters.values({"omega": 2.0, "pitch_amplitude": 0.1, "heave_amplitude": 0.04})
    for tau in np.linspace(0, 2 * np.pi, 7):
        for a, b in zip(about.excitation(tau, values), with_heave.excitation(tau, other), strict=True):
            np.testing.assert_allclose(np.array(a), np.array(b), atol=1e-14)


def test_any_periodic_motion_can_be_given():
    membrane, rom = QuasiLinearMembrane(prestrain=0.008, n_modes=3), thin_airfoil(3)
    wing = membrane_wing(
        membrane,
        rom,
        motion=lambda tau, p: (p.a * ca.sin(tau) + p.b * ca.cos(2 * tau), p.c * ca.cos(3 * tau)),
        pitch_axis=0.25,
        parameters={"a": 0.1, "b": 0.02, "c": 0.03},
    )
    assert "pitch_amplitude" not in wing.parameters.names
    problem, x, values = balanced(wing, {"omega": 0.7}, 5, n_steps=10)
    out = outputs_of(problem, x, values)
    np.testing.assert_allclose(out["alpha"], [0, -0.1j, 0.02, 0, 0, 0], atol=1e-15)
    np.testing.assert_allclose(out["z"], [0, -0.025j, 0.005, 0.03, 0, 0], atol=1e-15)
    np.testing.assert_allclose(out["alpha_acceleration"], [0, 0.1j * 0.49, -0.02 * 4 * 0.49, 0, 0, 0], atol=1e-15)


def test_the_default_motion_can_be_written_by_a_user():
    membrane, rom = QuasiLinearMembrane(n_modes=2), thin_airfoil(2)
    own = membrane_wing(
        membrane,
        rom,
        motion=lambda tau, p: [p.amplitude * ca.sin(tau), 0.0],
        parameters={"amplitude": 0.1, "omega": 2.0},
    )
    default = membrane_wing(membrane, rom, parameters={"pitch_amplitude": 0.1, "omega": 2.0})
    a = own.excitation(0.3, own.parameters.values())[0]
    b = default.excitation(0.3, default.parameters.values())[0]
    np.testing.assert_allclose(np.array(a), np.array(b), rtol=1e-14)


def test_a_rom_of_more_modes_gives_its_leading_block():
    membrane = QuasiLinearMembrane(n_modes=3)
    large, small = membrane_wing(membrane, thin_airfoil(8)), membrane_wing(membrane, thin_airfoil(3))
    np.testing.assert_allclose(large.linearisation(), small.linearisation(), atol=1e-12)


def test_forces_are_recognised_as_linear_cubic_and_not_polynomial():
    rom = thin_airfoil(3)
    assert not membrane_wing(LinearMembrane(n_modes=3), rom).is_nonlinear
    assert polynomial_degree(membrane_wing(QuasiLinearMembrane(n_modes=3), rom)) == 3
    assert polynomial_degree(membrane_wing(NonlinearMembrane(n_modes=3), rom)) is None


def test_parameters_start_at_the_membranes_values_and_stay_symbols():
    membrane = QuasiLinearMembrane(mass_ratio=0.3, stiffness=80.0, prestrain=0.03, n_modes=2)
    wing = membrane_wing(membrane, thin_airfoil(2), parameters={"pitch_amplitude": 0.04})
    defaults = wing.parameters.defaults
    assert (defaults["mass_ratio"], defaults["stiffness"], defaults["prestrain"]) == (0.3, 80.0, 0.03)
    assert defaults["pitch_amplitude"] == 0.04
    other = membrane_wing(
        QuasiLinearMembrane(mass_ratio=0.7, stiffness=90.0, prestrain=0.02, n_modes=2), thin_airfoil(2)
    )
    at = {"mass_ratio": 0.7, "stiffness": 90.0, "prestrain": 0.02}
    np.testing.assert_allclose(wing.linearisation(at), other.linearisation(), rtol=1e-14)


# --- bad input


def test_a_rom_of_fewer_modes_is_refused():
    with pytest.raises(ValueError, match=r"ROM has 4 modes and the membrane 10.*at least 10 modes, or.*n_modes=4"):
        membrane_wing(QuasiLinearMembrane(), thin_airfoil(4))


def test_what_is_no_membrane_or_no_rom_is_refused():
    with pytest.raises(TypeError, match="membrane is 10; give a LinearMembrane"):
        membrane_wing(10, thin_airfoil(4))
    with pytest.raises(TypeError, match=r"rom is 'thin airfoil'; give an AeroROM.*n_modes=10"):
        membrane_wing(QuasiLinearMembrane(), "thin airfoil")


def test_motions_that_are_no_pair_are_refused():
    membrane, rom = QuasiLinearMembrane(n_modes=1), thin_airfoil(1)
    for motion in (lambda tau, p: ca.sin(tau), lambda tau, p: ca.vertcat(tau, tau, tau), lambda tau, p: [1, 2, 3]):
        with pytest.raises(ValueError, match=r"motion returned [13] expressions; two are needed, \(alpha, heave\)"):
            membrane_wing(membrane, rom, motion=motion)


def test_unknown_parameters_are_refused_with_the_nearest_name():
    with pytest.raises(KeyError, match=r"pitch_amplitud.*did you mean 'pitch_amplitude'"):
        membrane_wing(QuasiLinearMembrane(n_modes=1), thin_airfoil(1), parameters={"pitch_amplitud": 0.1})
    with pytest.raises(TypeError, match="pitchaxis"):
        membrane_wing(QuasiLinearMembrane(n_modes=1), thin_airfoil(1), pitchaxis=0.1)


@pytest.mark.parametrize("name", ["mass_ratio", "stiffness", "prestrain"])
def test_values_that_no_membrane_has_are_refused_also_where_they_come_later(name):
    wing = membrane_wing(QuasiLinearMembrane(n_modes=2), thin_airfoil(2))
    problem = HarmonicBalance(pickle.loads(pickle.dumps(wing)), 1)  # noqa: S301 (our own)
    with pytest.raises(ValueError, match=f"give values of {name} of at least 0"):
        solve(problem, at={"omega": 1.0, name: -1.0})
    with pytest.raises(ValueError, match=f"give values of {name} of at least 0"):
        trace(problem, name, (1.0, -1.0), at={"omega": 1.0})
