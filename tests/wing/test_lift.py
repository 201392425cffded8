"""Linear lift response of membrane wings of several tensions, beside the rigid wing."""

import numpy as np
import pytest

from hbnlp.aero import theodorsen_transfer, thin_airfoil
from hbnlp.fourier import decibels
from hbnlp.systems import duffing
from hbnlp.wing.coupling import membrane_wing
from hbnlp.wing.lift import lift_response
from hbnlp.wing.membrane import LinearMembrane, QuasiLinearMembrane

OMEGA = np.geomspace(0.1, 60.0, 9)


@pytest.mark.parametrize("axis", [0.0, 0.25])
def test_response_is_that_of_the_coupled_transfer_functions(axis):
    rom, mu, n = thin_airfoil(6), 0.5, 6
    response = lift_response(
        membrane_wing(QuasiLinearMembrane(n_modes=6), rom, pitch_axis=axis), OMEGA, tensions=[2, 4]
    )
    k = np.arange(1, n + 1)
    inertia = 2 * mu * np.column_stack([-2 * (-1.0) ** k / (k * np.pi), -2 * (1 - (-1.0) ** k) / (k * np.pi)])
    u = np.array([1.0, axis])
    for i, s in enumerate(1j * OMEGA):
        g = rom.transfer(s)
        for j, c in enumerate((2.0, 4.0)):
            dynamic = np.diag(2 * mu * s**2 + k**2 * np.pi**2 * c) - g[1:, 2:]
            W = np.linalg.solve(dynamic, (g[1:, :2] + s**2 * inertia) @ u)
            assert response.membrane[j, i] == pytest.approx((g[0, :2] @ u + g[0, 2:] @ W) / s**2, rel=1e-9)
        assert response.rigid[i] == pytest.approx(g[0, :2] @ u / s**2, rel=1e-12)


def test_response_does_not_depend_on_the_amplitude():
    wing = membrane_wing(LinearMembrane(n_modes=2), thin_airfoil(2), parameters={"pitch_amplitude": 0.3})
    one = lift_response(wing, OMEGA, tensions=4.0)
    other = lift_response(wing, OMEGA, tensions=4.0, at={"pitch_amplitude": 0.01})
    np.testing.assert_allclose(other.membrane, one.membrane, rtol=1e-12)
    assert one.membrane.shape == (1, 9)


def test_tight_membranes_tend_to_the_rigid_wing_and_that_to_theodorsens():
    wing = membrane_wing(LinearMembrane(n_modes=3), thin_airfoil(3))
    response = lift_response(wing, OMEGA, tensions=[1e6, 1e7])
    distance = np.max(np.abs(response.membrane / response.rigid - 1), axis=1)
    assert distance[1] < 1e-2
    assert distance[0] / distance[1] == pytest.approx(10.0, rel=0.1)
    exact = theodorsen_transfer(1j * OMEGA, 0)[:, 0, 0] / -(OMEGA**2)
    assert np.max(np.abs(response.rigid / exact - 1)) < 0.03


def test_static_limit_is_the_sail_equations_lift():
    rom = thin_airfoil(4)
    response = lift_response(membrane_wing(LinearMembrane(n_modes=4), rom), 1e-6, tensions=[3.0])
    k = np.arange(1, 5)
    W = np.linalg.solve(np.diag(k**2 * np.pi**2 * 3.0) - rom.stiffness[1:, 2:], rom.stiffness[1:, 0])
    lift = rom.stiffness[0, 0] + rom.stiffness[0, 2:] @ W
    assert -response.membrane[0, 0] * 1e-12 == pytest.approx(lift, rel=1e-5)


def test_growth_tells_divergent_wings_and_the_repr_says_so():
    response = lift_response(membrane_wing(LinearMembrane(n_modes=3), thin_airfoil(3)), OMEGA, tensions=[1.0, 4.0])
    assert response.growth[0] > 0.0 > response.growth[1]
    assert repr(response).splitlines() == [
        "LiftResponse: 9 frequencies from 0.1 to 60",
        "  c_T = 1 (unstable), 4, and rigid",
    ]


def test_decibels():
    np.testing.assert_allclose(decibels([10.0, 0.1j]), [20.0, -20.0])


@pytest.mark.parametrize(
    ("omega", "tensions", "at", "message"),
    [
        ([0.0, 1.0], [4.0], None, r"omega is .*0\.0.*greater than 0"),
        (1.0, [4.0, -1.0], None, r"tensions is .*-1\.0"),
        (1.0, 4.0, {"pitch_amplitude": 0.0}, "does not pitch"),
    ],
)
def test_bad_values_are_refused(omega, tensions, at, message):
    wing = membrane_wing(LinearMembrane(n_modes=1), thin_airfoil(1))
    with pytest.raises(ValueError, match=message):
        lift_response(wing, omega, tensions=tensions, at=at)


def test_systems_that_are_no_wing_are_refused():
    with pytest.raises(ValueError, match="'Duffing oscillator' is no membrane wing"):
        lift_response(duffing(), 1.0, tensions=4.0)
