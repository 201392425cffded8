"""The linear wing as a system of python-control: what `lift_response`, `eigenvalues` and the balance say of it."""

import control
import numpy as np
import pytest

import hbnlp
from hbnlp.systems.linear_stability import eigenvalues


@pytest.fixture(scope="module")
def wing():
    membrane = hbnlp.QuasiLinearMembrane(prestrain=0.008, n_modes=4)
    return hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(), pitch_axis=0.25)


OMEGA = np.geomspace(0.1, 30.0, 25)


def test_its_lift_is_the_lift_response_to_rounding(wing):
    system = hbnlp.linear_wing(wing)
    response = hbnlp.lift_response(wing, OMEGA, tensions=[4.0])
    gain = system["C_L", "alpha_acceleration"](1j * OMEGA)
    np.testing.assert_allclose(gain, response.membrane[0], rtol=1e-11)


def test_its_poles_are_the_eigenvalues_and_four_zeros_of_the_motion(wing):
    poles = hbnlp.linear_wing(wing).poles()
    order = np.argsort(np.abs(poles))
    np.testing.assert_allclose(poles[order[:4]], 0.0, atol=1e-12)
    ours = np.sort_complex(eigenvalues(wing))
    np.testing.assert_allclose(np.sort_complex(poles[order[4:]]), ours, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("motion", ["pitch", "heave"])
def test_every_output_is_that_of_a_small_motion_about_an_equilibrium(wing, motion):
    """The balance knows nothing of the state space: its first harmonics per acceleration, of 1e-6 of pitch or heave."""
    problem = hbnlp.HarmonicBalance(wing, 1)
    mean = {"pitch_mean": 0.04}
    steady = hbnlp.solve(problem, at={"omega": 1.0, **mean})
    system = hbnlp.linear_wing(wing, at=mean, rest=steady.coefficients[:, 0])
    small = 1e-6
    for omega in (0.7, 3.0):
        moving = hbnlp.solve(problem, at={"omega": omega, **mean, f"{motion}_amplitude": small}, start=steady)
        acceleration = -(omega**2) * small * -1j  # of small sin(tau)
        name = {"pitch": "alpha_acceleration", "heave": "heave_acceleration"}[motion]
        for output in wing.output_names:
            gain = system[output, name](1j * omega)
            assert moving.harmonics(output)[1] / acceleration == pytest.approx(gain, rel=1e-5, abs=1e-8), output


def test_a_membrane_is_linear_about_its_equilibrium_and_stiffer_than_about_rest(wing):
    steady = hbnlp.solve(hbnlp.HarmonicBalance(wing, 1), at={"omega": 1.0, "pitch_mean": 0.04})
    rest = steady.coefficients[:, 0]
    about = hbnlp.linear_wing(wing, at={"pitch_mean": 0.04}, rest=rest)
    fastest = max(about.poles().imag)
    assert fastest > max(hbnlp.linear_wing(wing).poles().imag)
    assert fastest == pytest.approx(max(eigenvalues(wing, rest=rest).imag))


def test_signals_have_names(wing):
    system = hbnlp.linear_wing(wing)
    assert system.input_labels == ["alpha_acceleration", "heave_acceleration"]
    assert system.output_labels == [*wing.output_names]
    assert system.state_labels[:6] == ["alpha", "heave", "alpha_velocity", "heave_velocity", "W1", "W2"]
    assert system.dt == 0


def test_frequency_responses_are_data_of_python_control(wing):
    response = hbnlp.lift_response(wing, OMEGA, tensions=[3.0, 4.0])
    data = response.to_frd()
    assert data.output_labels == ["C_L_1", "C_L_2", "C_L_rigid"]
    np.testing.assert_array_equal(data["C_L_2", "alpha_acceleration"].frdata[0, 0], response.membrane[1])
    system = hbnlp.linear_wing(wing)["C_L", "alpha_acceleration"]
    np.testing.assert_allclose(control.frd(system, OMEGA).frdata[0, 0], response.membrane[1], rtol=1e-11)
    flow = hbnlp.aero.flat_plate_re100_response().truncated(1)
    loads = flow.to_frd()
    assert (loads.input_labels, loads.output_labels) == (["alpha", "z", "W_1"], ["C_L", "dCp_1"])
    np.testing.assert_array_equal(loads["dCp_1", "z"].frdata[0, 0], flow.values[:, 1, 1])


def test_what_is_no_wing_with_its_own_motion_is_refused():
    with pytest.raises(ValueError, match="has no pitch_amplitude and heave_amplitude; give a wing with its own motion"):
        hbnlp.linear_wing(hbnlp.systems.duffing())
    with pytest.raises(TypeError, match=r"a wing made by hbnlp\.membrane_wing"):
        hbnlp.linear_wing(3)
