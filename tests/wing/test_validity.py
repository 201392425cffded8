"""What speaks against believing a wing's motion: measures known in closed form, limits, warnings, shading."""

import copy
import dataclasses
import pickle
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ellipe

import hbnlp
from hbnlp.aero import Provenance, thin_airfoil
from hbnlp.solutions.solution import make_solution

BAND, INCIDENCE = (0.1, 5.0), 0.02
PRESTRAIN = 0.002


def rom(n_modes=3):
    return dataclasses.replace(thin_airfoil(n_modes), provenance=Provenance(band=BAND, incidence=INCIDENCE))


def wing_of(membrane=hbnlp.QuasiLinearMembrane):
    return hbnlp.membrane_wing(membrane(prestrain=PRESTRAIN, n_modes=3), rom())


def motion_of(wing, amplitudes, **at):
    """Return a record, no solution, of modal amplitudes (3, 2H+1)."""
    problem = hbnlp.HarmonicBalance(wing, n_harmonics=np.shape(amplitudes)[1] // 2)
    values = problem.values({"omega": 1.0, **at})
    return make_solution(problem, np.asarray(amplitudes, dtype=float).ravel(), values)


def half_sine(height, n_harmonics=2):
    amplitudes = np.zeros((3, 2 * n_harmonics + 1))
    amplitudes[0, 0] = height
    return amplitudes


def elongation_of_half_sine(height):
    """Return int sqrt(1 + (pi a cos pi x)^2) dx - 1 by the complete elliptic integral of the second kind."""
    k = (np.pi * height) ** 2
    return 2.0 / np.pi * np.sqrt(1.0 + k) * ellipe(k / (1.0 + k)) - 1.0


@pytest.mark.parametrize("height", [0.02, 0.1, 0.3])
def test_the_error_of_the_quasi_linear_tension_is_that_of_its_strain(height):
    wing = wing_of()
    found = wing.validity(motion_of(wing, half_sine(height)))
    exact, small_slopes = elongation_of_half_sine(height), (np.pi * height) ** 2 / 4.0
    np.testing.assert_allclose(found.tension_error, (small_slopes - exact) / (PRESTRAIN + exact), rtol=1e-9)
    np.testing.assert_allclose(found.camber, height, rtol=1e-12)


def test_the_tension_of_the_nonlinear_membrane_has_no_error_and_that_of_the_linear_one_lacks_all_strain():
    motions = {kind: wing_of(kind) for kind in (hbnlp.NonlinearMembrane, hbnlp.LinearMembrane)}
    nonlinear, linear = (wing.validity(motion_of(wing, half_sine(0.1))) for wing in motions.values())
    assert nonlinear.tension_error < 1e-9
    exact = elongation_of_half_sine(0.1)
    np.testing.assert_allclose(linear.tension_error, exact / (PRESTRAIN + exact), rtol=1e-9)


def test_the_tension_is_that_of_the_parameters_of_the_motion():
    wing = wing_of()
    found = wing.validity(motion_of(wing, half_sine(0.1), prestrain=0.05))
    exact = elongation_of_half_sine(0.1)
    np.testing.assert_allclose(found.tension_error, ((0.1 * np.pi) ** 2 / 4.0 - exact) / (0.05 + exact), rtol=1e-9)


def test_the_camber_is_the_largest_over_the_period():
    wing, amplitudes = wing_of(), half_sine(0.02)
    amplitudes[0, 1:3] = 0.03, 0.04  # of amplitude 0.05
    assert wing.validity(motion_of(wing, amplitudes)).camber == pytest.approx(0.07, rel=5e-3)


@pytest.mark.parametrize(("omega", "share"), [(2.0, 0.0), (3.0, 8.0 / np.hypot(8.0, 3.0)), (6.0, 1.0), (0.01, 0.0)])
def test_what_is_beyond_the_band_is_counted_by_its_acceleration(omega, share):
    wing, amplitudes = wing_of(), np.zeros((3, 5))
    amplitudes[0, 1], amplitudes[1, 4] = 3.0, 2.0  # accelerations as 3 and 4 times 2
    found = wing.validity(motion_of(wing, amplitudes, omega=omega))
    np.testing.assert_allclose(found.beyond_band, share, rtol=1e-12)


def test_without_a_band_nothing_is_beyond_it():
    wing = hbnlp.membrane_wing(hbnlp.QuasiLinearMembrane(n_modes=3), thin_airfoil(3))
    assert wing.rom.provenance.band is None
    amplitudes = np.ones((3, 5))
    assert wing.validity(motion_of(wing, amplitudes, omega=1e3)).beyond_band == 0.0


def test_the_incidence_is_measured_from_that_of_the_rom():
    wing = wing_of()
    found = wing.validity(motion_of(wing, half_sine(0.0), pitch_mean=-0.05, pitch_amplitude=0.1))
    assert found.incidence == pytest.approx(0.15 + INCIDENCE, rel=5e-3)


def test_reasons_name_what_is_beyond_and_limits_are_the_users():
    wing = wing_of()
    motion = motion_of(wing, half_sine(0.3))
    found = wing.validity(motion)
    assert not found.within.any()
    camber, tension = found.reasons
    assert camber == "camber up to 0.3 (limit 0.1) at 1 point"
    assert "tension" in tension
    lenient = hbnlp.ValidityLimits(camber=0.4, tension_error=1.0)
    assert wing.validity(motion, limits=lenient).reasons == ()
    assert "all within the limits" in repr(wing.validity(motion, limits=lenient))
    with pytest.raises(ValueError, match="camber is -1"):
        hbnlp.ValidityLimits(camber=-1.0)


def test_an_amplitude_that_looks_like_degrees_is_named_when_it_is_given_and_when_it_is_met():
    membrane = hbnlp.QuasiLinearMembrane(n_modes=3)
    with pytest.warns(hbnlp.ValidityWarning, match=r"pitch_amplitude is 2.5 rad, .* give numpy.radians\(2.5\)") as seen:
        hbnlp.membrane_wing(membrane, rom(), parameters={"pitch_amplitude": 2.5})
    assert seen[0].filename == __file__
    wing = wing_of()
    found = wing.validity(motion_of(wing, half_sine(0.0), pitch_amplitude=2.5))
    assert "looks like degrees" in found.reasons[-1]


@pytest.fixture(scope="module")
def branch():
    problem = hbnlp.HarmonicBalance(wing_of(), n_harmonics=1)
    return hbnlp.trace(problem, "omega", (0.5, 4.0), at={"pitch_amplitude": 0.03, "prestrain": 0.008}, stability=None)


def test_a_branch_is_judged_point_by_point_and_shaded(branch):
    wing = branch.problem.system
    limit = float(np.median(wing.validity(branch).camber))
    found = wing.validity(branch, limits=hbnlp.ValidityLimits(camber=limit, tension_error=1e3))
    assert len(found) == len(branch)
    heights = [wing.membrane.camber(branch.solution(i).coefficients @ np.array([0.0, 1.0, 0.0])) for i in (0, 5)]
    assert all(found.camber[[0, 5]] >= heights)
    np.testing.assert_array_equal(found.within, found.camber <= limit)
    assert 0 < np.count_nonzero(found.within) < len(branch)
    ax = branch.plot("C_L", validity=found)
    assert "beyond the model" in [text.get_text() for text in ax.get_legend().get_texts()]
    shaded = np.concatenate([line.get_xdata() for line in ax.lines if line.get_linewidth() == 9.0])
    # a step is shaded where one of its ends is beyond
    within = np.concatenate([[True], found.within, [True]])
    apart = within[:-2] & found.within & within[2:]
    assert np.isin(branch.parameter[~found.within], shaded).all()
    assert not np.isin(branch.parameter[apart], shaded).any()
    with pytest.raises(ValueError, match="that of this branch"):
        branch.plot("C_L", validity=wing.validity(branch.solution(0)))


def limited(**limits):
    membrane = hbnlp.QuasiLinearMembrane(prestrain=0.008, n_modes=3)
    wing = hbnlp.membrane_wing(membrane, hbnlp.aero.thin_airfoil(3), limits=hbnlp.ValidityLimits(**limits))
    return hbnlp.HarmonicBalance(wing, n_harmonics=3)


RUNS = {
    "solve": lambda problem, at: hbnlp.solve(problem, at={"omega": 0.5, **at}),
    "trace": lambda problem, at: hbnlp.trace(problem, "omega", (0.5, 0.6), at=at),
    "sweep": lambda problem, at: hbnlp.sweep(problem, "omega", [0.5, 0.55], at=at),
    "sweep by integration": lambda problem, at: hbnlp.sweep(
        problem.system, "omega", [0.5, 0.55], at=at, periodic_tol=1e-3
    ),
    "explore": lambda problem, at: hbnlp.explore(problem, "omega", (0.5, 0.6), at=at),
    "find_all": lambda problem, at: hbnlp.find_all(
        problem, at={"omega": 0.5, **at}, method=hbnlp.Search(n_starts=1), rng=np.random.default_rng(0)
    ),
}


@pytest.mark.filterwarnings("default::hbnlp.ValidityWarning")
@pytest.mark.parametrize("run", RUNS)
def test_each_run_warns_once_of_motions_beyond_the_limits(run):
    at = {"pitch_amplitude": 0.03}
    with pytest.warns(hbnlp.ValidityWarning, match="camber up to .* see wing.validity") as seen:
        RUNS[run](limited(camber=1e-9), at)
    assert [Path(each.filename).name for each in seen] == ["test_validity.py"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        RUNS[run](limited(camber=1e3, tension_error=1e3, incidence=1e3), at)


def test_an_amplitude_in_degrees_is_told_of_where_it_is_given():
    with pytest.warns(hbnlp.ValidityWarning, match=r"2.5 rad looks like degrees: give numpy.radians"):
        hbnlp.solve(limited(), at={"omega": 0.5, "pitch_amplitude": 2.5})


@pytest.mark.parametrize("value", [3.0, np.int64(3)])
def test_a_wing_that_is_made_with_degrees_says_so_where_it_is_made(value):
    with pytest.warns(hbnlp.ValidityWarning, match=r"pitch_mean is 3 rad, which looks like degrees") as seen:
        hbnlp.membrane_wing(hbnlp.QuasiLinearMembrane(n_modes=3), thin_airfoil(3), parameters={"pitch_mean": value})
    assert Path(seen[0].filename).name == "test_validity.py"


def test_a_warning_that_is_an_error_keeps_the_branch():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(hbnlp.TaskError, match="camber") as raised:
            RUNS["trace"](limited(camber=1e-9), {"pitch_amplitude": 0.03})
    assert raised.value.result.parameter[-1] == 0.6


def test_a_wing_that_was_sent_or_copied_still_knows_what_it_is_made_of(branch):
    wing = branch.problem.system
    sent = pickle.loads(pickle.dumps(branch))  # noqa: S301
    for other in (sent.problem.system, copy.copy(wing), copy.deepcopy(wing)):
        assert other is not wing
        assert other.membrane == wing.membrane
        assert other.rom == wing.rom
        np.testing.assert_array_equal(other.validity(sent).camber, wing.validity(branch).camber)
    assert pickle.loads(pickle.dumps(branch)).problem.system is sent.problem.system  # noqa: S301


def test_records_of_other_systems_and_other_things_are_refused():
    wing = wing_of()
    duffing = hbnlp.HarmonicBalance(hbnlp.systems.duffing(), n_harmonics=1)
    with pytest.raises(ValueError, match="another system than a wing of 3 modes"):
        wing.validity(hbnlp.solve(duffing, at={"omega": 0.5}))
    for wrong in (1.0, None, "branch", wing):
        with pytest.raises(TypeError, match="a Solution, Branch, Sweep or Diagram of the wing"):
            wing.validity(wrong)
