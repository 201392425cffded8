"""Mistakes that were made: each is an error at once that says what to write instead."""

import dataclasses

import casadi as ca
import numpy as np
import pytest

import hbnlp
from hbnlp import aero, design, dns, identification, systems


@pytest.fixture(scope="module")
def problem():
    """A Duffing oscillator with one harmonic."""
    return hbnlp.HarmonicBalance(systems.duffing(), 1)


@pytest.fixture(scope="module")
def branch(problem):
    """Without its folds."""
    return hbnlp.trace(problem, "omega", (0.5, 0.7), stability=None)


WITH_PROBLEM = {
    "a parameter as an argument": (lambda p: hbnlp.solve(p, omega=1), r"no argument 'omega'.*at=\{'omega': 1\}"),
    "of the eigenvalues, too": (lambda p: hbnlp.eigenvalues(p.system, force=1), r"given with at=\{'force': 1\}"),
    "a misspelt argument": (lambda p: hbnlp.solve(p, thow=False), "no argument 'thow'; did you mean 'throw'"),
    "values as a list": (lambda p: hbnlp.solve(p, at=[1.0]), r"at is \[1.0\]; give a mapping"),
    "a start of text": (lambda p: hbnlp.solve(p, at={"omega": 1.0}, start="x"), "start is 'x'; give an array"),
    "the span as an array": (lambda p: hbnlp.trace(p, "omega", np.linspace(1, 2, 9)), "span is array.*; give two "),
    "a span to a sweep": (lambda p: hbnlp.sweep(p, "omega", (0.5, 1.5)), r"values is \(0.5, 1.5\); .*linspace"),
    "a number as a name": (lambda p: hbnlp.trace(p, 3, (0.5, 1.0)), "unknown parameter 3"),
    "an output by its number": (lambda p: hbnlp.peaks(p, 0), "branch is HarmonicBalance.*; give a Branch"),
    "of the multipliers": (hbnlp.floquet, "solution is HarmonicBalance.*; give a Solution"),
    "of the truncation": (hbnlp.truncation_error, "solution is HarmonicBalance.*; give a Solution"),
    "of a switch": (hbnlp.switch_branch, "point is HarmonicBalance.*; give a special point"),
    "of eigenvalues": (hbnlp.eigenvalues, "system is HarmonicBalance.*; give a System"),
    "a billion harmonics": (lambda p: hbnlp.HarmonicBalance(p.system, 10**9), "n_harmonics is 1000000000; give"),
    "a negative noise": (lambda p: hbnlp.Newton(tol=-1), "tol is -1; give a finite number"),
}


@pytest.mark.parametrize(("call", "message"), WITH_PROBLEM.values(), ids=WITH_PROBLEM)
def test_what_goes_wrong_with_a_problem_is_told(problem, call, message):
    with pytest.raises((TypeError, ValueError, KeyError), match=message):
        call(problem)


def _system(**options):
    return hbnlp.System([[1.0]], [[0.1]], [[1.0]], **options)


OPTIONS = {
    "half an iteration": (lambda: hbnlp.Newton(max_iterations=2.5), "max_iterations is 2.5; give an integer"),
    "no number of points": (lambda: hbnlp.PseudoArclength(max_points=np.nan), "max_points is nan; give an integer"),
    "half a node": (lambda: hbnlp.Floquet(nodes=2.5), "nodes is 2.5; give an integer from 1 to 10"),
    "no number of starts": (lambda: hbnlp.Search(n_starts=np.nan), "n_starts is nan; give an integer"),
    "nowhere to save": (lambda: hbnlp.Autosave(None), "path is None; give the path of a file"),
    "a tolerance of ten": (lambda: hbnlp.Adaptive(rtol=10), "rtol is 10; give .* less than 1"),
    "a letter": (lambda: hbnlp.QuasiLinearMembrane(mu=0.5), "no argument 'mu'; it is called 'mass_ratio'"),
    "a fit for its ROM": (
        lambda: hbnlp.membrane_wing(hbnlp.LinearMembrane(n_modes=1), _fit()),
        "rom is .*; give its ROM, the attribute `rom` of the RationalFit",
    ),
    "an axis nowhere": (lambda: _wing(pitch_axis=np.nan), "pitch_axis is nan"),
    "a negative mass": (lambda: _wing(parameters={"mass_ratio": -1}), r"parameters\['mass_ratio'\] is -1; give"),
    "a motion of nothing": (lambda: _system(motion=lambda tau, p: ca.sin(tau)), "motion is .*input_stiffness"),
    "lag states alone": (lambda: _system(lag_state=[[-1.0]]), "lag_output is None; give"),
    "a list of forces": (lambda: _system(forcing=[1.0]), r"forcing is \[1.0\]; give a function of \(tau, p\)"),
    "an endless frequency": (
        lambda: aero.FrequencyResponse(omega=[1.0, np.inf], values=0.0, static=0.0, base_load=0.0),
        r"omega\[1\] is inf; give an array of finite",
    ),
    "too fine an aerofoil": (lambda: aero.thin_airfoil(10**4), "n_modes is 10000; give an integer from 0 to 1000"),
    "half a level": (lambda: dns.Grid.around_plate(levels=2.5), "levels is 2.5; give an integer"),
    "half a cell": (lambda: dns.Grid.around_plate(cells=25.5), "cells is 25.5; give an integer"),
    "never": (lambda: dns.Checkpoint("state.npz", every=0), "every is 0; give an integer of at least 1"),
    "points of text": (lambda: dns.Points("x"), "positions is 'x'; give an array"),
    "no structure": (lambda: dns.Membrane("x"), "structure is 'x'; give a membrane"),
    "no grid": (lambda: dns.Simulation("x", dns.SharpPlate()), "grid is 'x'; give a Grid"),
    "a motion without rates": (lambda: dns.Motion(pitch=lambda t: np.nan), r"pitch\(0.0\) is nan; give .*shape \(3,\)"),
    "a motion that fails": (lambda: dns.Motion(heave=lambda: 0.0), "heave is .*at time 0 it raised TypeError"),
    "a deflection of another size": (
        lambda: dns.SharpPlate(lambda t: (np.zeros(3), np.zeros(3)), n_modes=2),
        r"deflection\(0.0\) has shape \(3,\)",
    ),
    "points that are no pairs": (
        lambda: dns.MovingPoints(lambda t: (0.0, 0.0), ((0.0, 1.0), (0.0, 1.0))),
        r"motion\(0.0\) has shape \(\)",
    ),
    "two turns and a half": (lambda: dns.Motion.at_incidence(900.0), "degrees is 900.0; give .* of at most 180"),
    "faster than the samples": (
        lambda: dns.harmonics(0.1 * np.arange(99), np.ones(99), omegas=[1.0, 40.0]),
        "omegas is .*; give frequencies below 31.4",
    ),
    "times out of order": (lambda: dns.harmonics([0.0, 2.0, 1.0, 3.0], np.ones(4), [3.0]), "time is .*; give rising"),
    "no variables": (lambda: design.Variables({}), r"bounds is \{\}; give one parameter at least"),
    "a system of nothing": (lambda: hbnlp.System(*np.zeros((3, 0, 0))), "mass is .*one degree of freedom at least"),
    "a parameter of a system": (lambda: _system(k=2.0), r"no argument 'k'; .*with parameters=\{'k': 2.0\}"),
    "a parameter of a wing": (
        lambda: _wing(stiffness=2.0),
        r"no argument 'stiffness'; .*parameters=\{'stiffness': 2.0",
    ),
    "an error of two": (lambda: aero.identify(_data(), tolerance=2.0), "tolerance is 2.0; give .* less than 1"),
    "a balanced number": (lambda: aero.balanced_truncation(3, 1), "rom is 3; give an AeroROM"),
}


def _wing(**options):
    return hbnlp.membrane_wing(hbnlp.LinearMembrane(n_modes=1), aero.thin_airfoil(1), **options)


def _data():
    rom, omega = aero.thin_airfoil(1), np.linspace(0.1, 1.0, 9)
    return aero.FrequencyResponse(
        omega=omega, values=rom.transfer(1j * omega), static=rom.stiffness, base_load=np.zeros(2)
    )


def _fit():
    return aero.identify(_data(), tolerance=0.1)


@pytest.mark.parametrize(("call", "message"), OPTIONS.values(), ids=OPTIONS)
def test_what_goes_wrong_on_the_way_there_is_told(call, message):
    with pytest.raises((TypeError, ValueError), match=message):
        call()


def test_there_is_no_harmonic_0_of_a_peak_and_no_output_0(branch):
    with pytest.raises(ValueError, match="harmonic is 0; give an integer from 1 to 1"):
        hbnlp.peaks(branch, "x", harmonic=0)
    with pytest.raises(KeyError, match=r"unknown output 0 \(known: x\)"):
        branch.harmonics(0)


def test_a_table_is_not_what_save_writes(branch, tmp_path):
    with pytest.raises(ValueError, match=r"path is .*branch.csv.*; give a name that ends in .npz"):
        branch.save(tmp_path / "branch.csv")
    assert not (tmp_path / "branch.csv").exists()


def test_a_force_beyond_measure_is_told(problem):
    with pytest.raises(ValueError, match=r"load of forcing or motion is 1.*e\+200"):
        hbnlp.solve(problem, at={"omega": 1.0, "force": 1e200})


def test_a_force_too_small_to_measure_is_told(problem):
    with pytest.raises(ValueError, match=r"load of forcing or motion is 1.*e-300; give none, or one from 1e-140"):
        hbnlp.solve(problem, at={"omega": 1.0, "force": 1e-300})
    assert hbnlp.solve(problem, at={"omega": 1.0, "force": 0.0}).converged


def test_an_excitation_of_which_nothing_would_be_kept_is_told():
    system = hbnlp.System(1.0, 0.1, 1.0, forcing=lambda tau, p: [p.mean + ca.cos(20 * tau)], parameters={"mean": 0.0})
    for options, needed in (({"n_harmonics": 3}, 20), ({"n_harmonics": 39, "periods": 2}, 40)):
        problem = hbnlp.HarmonicBalance(system, **options)
        message = f"n_harmonics is {options['n_harmonics']}; give {needed} or more: forcing .* harmonic 20 of omega"
        with pytest.raises(ValueError, match=message):
            hbnlp.solve(problem, at={"omega": 0.1})
        with pytest.raises(ValueError, match=message):
            hbnlp.trace(problem, "omega", (0.1, 0.2), at={"mean": 1.0})
    assert hbnlp.solve(hbnlp.HarmonicBalance(system, 20), at={"omega": 0.1}).converged


def test_an_infinite_term_of_a_force_is_told():
    system = hbnlp.System(1.0, 0.1, 1.0, nonlinear_force=lambda q, v, tau, p: [q[0] ** 3 + np.inf])
    with pytest.raises(hbnlp.NonFiniteError, match="the value of nonlinear_force"):
        hbnlp.solve(hbnlp.HarmonicBalance(system, 1), at={"omega": 1.0})


def test_a_system_without_mass_has_no_solution_here():
    system = hbnlp.System([[0.0]], [[1.0]], [[1.0]], forcing=lambda tau, p: [ca.cos(tau)])
    with pytest.raises(ValueError, match="mass matrix is singular"):
        hbnlp.solve(hbnlp.HarmonicBalance(system, 1), at={"omega": 1.0})


def test_an_image_by_what_is_no_symmetry_is_refused(branch):
    with pytest.raises(TypeError, match=r"symmetry is 3; give an hbnlp.Symmetry"):
        branch.solution(0).image(3)


@pytest.mark.parametrize("measured", [[-1.0], [0.0]])
def test_measured_amplitudes_are_not_negative_nor_nothing(problem, branch, measured):
    found = branch.solution(0)
    fit = identification.Identification(
        design.Variables({"force": (0.1, 0.3)}), problem, [(found.parameters, found)], "x"
    )
    with pytest.raises(ValueError, match=r"measured is .*; give amplitudes, which are not negative"):
        fit.fit(measured, {"force": 0.2})


def test_what_json_cannot_write_is_named_and_nothing_is_written(tmp_path):
    data = dataclasses.replace(_data(), provenance={"mesh": np.arange(3)})
    with pytest.raises(TypeError, match=r"provenance is not what JSON can write: array\(\[0, 1, 2\]\) is neither"):
        data.save(tmp_path / "g.npz")
    assert not list(tmp_path.iterdir())


def test_a_path_with_the_character_0_is_refused(branch, tmp_path):
    for verb in (branch.save, hbnlp.Branch.load):
        with pytest.raises(ValueError, match=r"path is .*without the character 0"):
            verb(f"{tmp_path}/a\0b")
