"""Linear stability about rest: eigenvalues, limits in any parameter, and the warning, against closed forms."""

import numpy as np
import pytest

from hbnlp.aero import thin_airfoil
from hbnlp.core.errors import LinearInstabilityWarning
from hbnlp.systems import chain, duffing
from hbnlp.systems.linear_stability import check_linear_stability, eigenvalues, stability_limits
from hbnlp.systems.system import System
from hbnlp.wing.coupling import membrane_wing
from hbnlp.wing.membrane import LinearMembrane, NonlinearMembrane, QuasiLinearMembrane


def ziegler():
    """Return Ziegler's double pendulum under a follower force P (masses 2:1, unit springs and lengths)."""
    return System(
        [[3.0, 1.0], [1.0, 1.0]],
        np.zeros((2, 2)),
        lambda p: [[2.0 - p.P, p.P - 1.0], [-1.0, 1.0]],
        parameters={"P": 0.0},
    )


def test_eigenvalues_of_an_oscillator_are_its_formula():
    found = eigenvalues(duffing(damping_ratio=0.1))
    np.testing.assert_allclose(found, [-0.1 + 1j * np.sqrt(0.99), -0.1 - 1j * np.sqrt(0.99)], rtol=1e-14)


def test_eigenvalues_with_a_lag_state_are_the_characteristic_polynomials_roots():
    # (s^2 + 0.3 s + 2) (s + 0.5) = -0.4 0.7 s^2
    system = System([[1.0]], [[0.3]], [[2.0]], lag_state=[[-0.5]], lag_input=[[0.7]], lag_output=[[-0.4]])
    roots = np.roots([1.0, 0.3 + 0.5 + 0.28, 2.0 + 0.15, 1.0])
    np.testing.assert_allclose(np.sort_complex(eigenvalues(system)), np.sort_complex(roots), rtol=1e-12)


def test_rest_shifts_the_linearisation():
    found = eigenvalues(duffing(damping_ratio=0.0, cubic=0.1), rest=[2.0])
    np.testing.assert_allclose(np.abs(found), np.sqrt(1 + 3 * 0.1 * 4.0), rtol=1e-14)


@pytest.mark.parametrize(("n_modes", "tension"), [(1, 1.709261), (10, 1.726336)])
@pytest.mark.parametrize("model", [LinearMembrane, QuasiLinearMembrane, NonlinearMembrane])
def test_the_sail_equation_diverges_at_its_known_tension(model, n_modes, tension):
    wing = membrane_wing(model(n_modes=n_modes), thin_airfoil(n_modes))
    (limit,) = stability_limits(wing, "prestrain", (0.002, 0.02), n_points=9)
    assert limit.value * 500 == pytest.approx(tension, abs=6e-7)
    assert (limit.kind, limit.frequency, limit.unstable) == ("divergence", 0.0, "below")


def test_limits_at_low_tension_are_those_of_the_static_eigenvalue_problem_and_flutter():
    rom = thin_airfoil(10)
    wing = membrane_wing(QuasiLinearMembrane(), rom)
    limits = stability_limits(wing, "prestrain", (0.0008, 0.02))
    k = np.arange(1, 11)
    static = np.linalg.eigvals(np.diag(1 / (k * np.pi) ** 2) @ rom.stiffness[1:, 2:])
    static = np.sort(static.real[(np.abs(static.imag) < 1e-9) & (static.real > 0.4)]) / 500
    np.testing.assert_allclose([e.value for e in limits if e.kind == "divergence"], static, rtol=1e-9)
    flutter = [e for e in limits if e.kind == "flutter"]
    for e in flutter:
        values = eigenvalues(wing, {"prestrain": e.value})
        assert np.min(np.abs(values - 1j * e.frequency)) < 1e-9


def test_divergence_in_any_other_parameter_is_the_same_limit():
    wing = membrane_wing(QuasiLinearMembrane(prestrain=0.004, n_modes=1), thin_airfoil(1))
    (limit,) = stability_limits(wing, "stiffness", (100.0, 1000.0))
    # pi^2 c_T = dCp_1 per W_1 = 16.8697305419 (test_thin_airfoil.py), with c_T = 2 Eh delta0
    assert limit.value == pytest.approx(1.7092610662319 / 0.008, rel=1e-10)
    assert stability_limits(wing, "mass_ratio", (0.01, 5.0)) == ()


def test_flutter_of_a_negatively_damped_oscillator():
    system = System([[1.0]], lambda p: [[0.2 - p.gain]], [[4.0]], parameters={"gain": 0.0})
    (limit,) = stability_limits(system, "gain", (0.0, 1.0))
    assert limit.value == pytest.approx(0.2, abs=1e-12)
    assert (limit.kind, limit.unstable) == ("flutter", "above")
    assert limit.frequency == pytest.approx(2.0, rel=1e-6)
    assert stability_limits(system, "gain", (1.0, 0.0)) == (limit,)


def test_flutter_of_ziegler_s_pendulum():
    # undamped: P = 7/2 - sqrt(2), where two neutral pairs meet
    limits = stability_limits(ziegler(), "P", (0.0, 3.0))
    assert [e.kind for e in limits] == ["flutter"]
    assert limits[0].value == pytest.approx(3.5 - np.sqrt(2), abs=1e-7)


def test_two_limits_between_neighbouring_points_are_found():
    system = System([[1.0]], lambda p: [[(p.a - 0.51) ** 2 - 1e-4]], [[1.0]], parameters={"a": 0.0})
    limits = stability_limits(system, "a", (0.0, 1.0), n_points=9)
    np.testing.assert_allclose([e.value for e in limits], [0.50, 0.52], rtol=1e-9)
    assert [e.unstable for e in limits] == ["above", "below"]


def test_unstable_wing_is_a_warning_that_names_eigenvalue_and_tension():
    wing = membrane_wing(QuasiLinearMembrane(n_modes=4), thin_airfoil(4))
    with pytest.warns(
        LinearInstabilityWarning, match=r"membrane wing.*c_T = 1: eigenvalue 0\.9\d+\+0j \(divergence\), 1 of 10"
    ):
        values = check_linear_stability(wing)
    assert values[0].real > 0.9
    with pytest.warns(LinearInstabilityWarning, match=r"about rest: eigenvalue .*\(flutter\)"):
        check_linear_stability(ziegler(), {"P": 2.5})


def test_stable_and_neutral_systems_do_not_warn():
    check_linear_stability(membrane_wing(QuasiLinearMembrane(n_modes=4), thin_airfoil(4)), {"prestrain": 0.008})
    check_linear_stability(duffing(damping_ratio=0.0))
    check_linear_stability(chain(10, damping=0.0))
    check_linear_stability(ziegler())


@pytest.mark.parametrize(
    ("parameter", "span", "error", "message"),
    [
        ("P", (1.0, 1.0), ValueError, r"span is \(1\.0, 1\.0\); give two different finite values of P"),
        ("P", (0.0, np.inf), ValueError, r"span is \(0\.0, inf\)"),
        ("P", (0.0, 1.0, 2.0), ValueError, r"span is \(0\.0, 1\.0, 2\.0\); give two different"),
        ("Q", (0.0, 1.0), KeyError, "unknown parameter 'Q'"),
        ("omega", (0.1, 1.0), ValueError, "does not depend"),
    ],
)
def test_bad_spans_and_names_are_refused(parameter, span, error, message):
    with pytest.raises(error, match=message):
        stability_limits(ziegler(), parameter, span)


def rotor(name="omega"):
    """A disc on a shaft that turns at omega: gyroscopic coupling, and damping that turns with it."""

    def matrix(direct, cross):
        return lambda p: [[direct, cross * p[name]], [-cross * p[name], direct]]

    return System(np.eye(2), matrix(0.05, 1.0), matrix(1.0, 0.2), parameters={} if name == "omega" else {name: np.nan})


def test_omega_is_used_where_the_matrices_depend_on_it():
    """Whirl grows from omega = 1 / sqrt(12) on (numpy eigenvalues of the state matrix, brentq: 0.2886751345948)."""
    system = rotor()
    (limit,) = stability_limits(system, "omega", (0.01, 3.0))
    assert limit.value == pytest.approx(0.2886751345948187, rel=1e-10)
    assert (limit.kind, limit.unstable) == ("flutter", "above")
    (other,) = stability_limits(rotor("speed"), "speed", (0.01, 3.0))
    assert other.value == pytest.approx(limit.value, rel=1e-12)
    assert [e.value for e in stability_limits(system, "omega", (-3.0, 3.0))] == pytest.approx(
        [-limit.value, limit.value]
    )
    assert eigenvalues(system, {"omega": 2.0})[0].real == pytest.approx(0.09829519301660522, rel=1e-10)
    assert eigenvalues(system, {"omega": 0.0})[0].real == pytest.approx(-0.025, rel=1e-12)
    with pytest.warns(LinearInstabilityWarning, match="flutter"):
        check_linear_stability(system, {"omega": 2.0})


FORCES = {
    "a stiffness": (lambda q, v, tau, p: [p.omega * q[0]], None),
    "a damping": (lambda q, v, tau, p: [v[0] / p.omega], None),
    "a cubic force away from zero": (lambda q, v, tau, p: [p.omega * q[0] ** 3], [1.0]),
}


@pytest.mark.parametrize(("force", "rest"), FORCES.values(), ids=FORCES)
def test_omega_is_asked_for_where_the_force_depends_on_it(force, rest):
    system = System(1.0, 0.1, 1.0, nonlinear_force=force)
    for call in (eigenvalues, check_linear_stability):
        with pytest.raises(ValueError, match=r"depends on omega, which has no value; give one, .*at=\{'omega'"):
            call(system, rest=rest)
        assert np.all(call(system, {"omega": 2.0}, rest=rest).real < 0.0)
    with pytest.raises(ValueError, match="depends on omega, which has no value"):
        eigenvalues(rotor())


def test_omega_is_not_asked_for_where_only_large_motions_depend_on_it():
    system = System(1.0, 0.1, 1.0, nonlinear_force=lambda q, v, tau, p: [q[0] ** 3 / p.omega + p.omega**2])
    np.testing.assert_allclose(eigenvalues(system), eigenvalues(System(1.0, 0.1, 1.0)))
    with pytest.raises(ValueError, match="does not depend"):
        stability_limits(system, "omega", (0.1, 1.0))
