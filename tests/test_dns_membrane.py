"""The membrane's force law and its coupling with the flow."""

import math

import numpy as np
import pytest
import scipy.optimize

import hbnlp
from hbnlp import dns
from hbnlp.dns.membrane import MembraneShape, inertial_load
from hbnlp.dns.plate import PlateWall


def _shape(flow: dns.Simulation) -> MembraneShape:
    assert isinstance(flow.wall, PlateWall)
    assert isinstance(flow.wall.shape, MembraneShape)
    return flow.wall.shape


LAW = dns.NonlinearTension(stretching=250.0, prestrain=0.002, n_modes=4)


def test_force_derives_from_the_energy_and_the_tangent_from_the_force() -> None:
    deflection = np.array([0.05, -0.02, 0.01, 0.003])
    step = 1e-6
    for k in range(4):
        shift = step * np.eye(4)[k]
        slope = (LAW.energy(deflection + shift) - LAW.energy(deflection - shift)) / (2 * step)
        assert slope == pytest.approx(LAW.restoring(deflection)[k], rel=1e-7, abs=1e-7)
        column = (LAW.restoring(deflection + shift) - LAW.restoring(deflection - shift)) / (2 * step)
        np.testing.assert_allclose(LAW.tangent(deflection)[:, k], column, rtol=1e-7, atol=1e-4)


def test_small_deflections_feel_the_prestress_only() -> None:
    # c_T0 = 2 Eh delta0 = 1
    np.testing.assert_allclose(LAW.restoring(np.full(4, 1e-7)), 1e-7 * (np.pi * np.arange(1, 5)) ** 2, rtol=1e-8)


def test_uniform_pressure_bends_the_membrane_to_a_circular_arc() -> None:
    """Half-angle f: delta = f / sin f - 1, camber tan(f/2)/2, p = 2 c_T sin f."""
    law = dns.NonlinearTension(stretching=250.0, prestrain=0.002, n_modes=12)
    half_angle = 0.25
    pressure = 2.0 * 500.0 * (0.002 + half_angle / math.sin(half_angle) - 1.0) * math.sin(half_angle)
    k = np.arange(1, 13)
    load = pressure * 2.0 * (1.0 - (-1.0) ** k) / (k * np.pi)
    found = scipy.optimize.root(lambda w: law.restoring(w) - load, np.zeros(12) + 0.06 * (k == 1), jac=law.tangent)
    camber = float(found.x @ np.sin(0.5 * np.pi * k))
    # twelve sine modes represent the arc's corner of curvature at the ends to 1e-4 of the camber
    assert camber == pytest.approx(0.5 * math.tan(0.5 * half_angle), rel=1e-3)
    assert law.strain(found.x) == pytest.approx(half_angle / math.sin(half_angle) - 1.0, rel=2e-3)


def test_membrane_in_vacuum_keeps_its_energy() -> None:
    membrane = dns.Membrane(mass_ratio=0.5, law=LAW, n_modes=4, deflection=np.array([0.08, 0.02, 0.0, 0.0]))
    shape = MembraneShape(membrane, dns.Motion(), 0.02)

    def energy() -> float:
        deflection, rate = shape.current
        return 0.5 * float(rate @ rate) + LAW.energy(deflection)

    start = energy()
    for step in range(200):
        shape.prepare(0.02 * (step + 1))
        shape.rates(np.zeros(4), np.zeros((4, 4)))
        shape.accept()
    # three Gauss points on a law that is no polynomial
    assert energy() == pytest.approx(start, rel=1e-6)


def test_inertial_load_has_the_sine_coefficients_of_x_and_one() -> None:
    motion = dns.Motion(pitch=lambda _: (0.0, 0.0, 3.0), heave=lambda _: (0.0, 0.0, 2.0))
    x = (np.arange(4000) + 0.5) / 4000
    expected = [2.0 * np.mean(2.0 * 0.7 * (3.0 * x - 2.0) * np.sin(k * np.pi * x)) for k in (1, 2, 3)]
    np.testing.assert_allclose(inertial_load(0.7, 3, motion)(0.0), expected, atol=1e-6)


@pytest.mark.parametrize("amplitude", [0.02, 0.08])
def test_energy_of_membrane_and_fluid_balances(amplitude: float) -> None:
    """A released membrane in fluid at rest: what it loses is in the fluid's motion or has been dissipated.

    In units of the modal equation, mu W'^2 + V for the membrane, 4 times the fluid's integrals: kinetic energy 1/2 int
    gamma psi, dissipation nu int omega^2.
    """
    membrane = dns.Membrane(mass_ratio=0.5, law=LAW, n_modes=4, deflection=np.array([amplitude, 0.0, 0.0, 0.0]))
    flow = dns.Simulation(dns.Grid.around_plate(cells=20, levels=3), membrane, dt=0.01, stream=0.0)
    shape = _shape(flow)

    def structure() -> float:
        deflection, rate = shape.current
        return 0.5 * float(rate @ rate) + LAW.energy(deflection)

    def dissipation() -> float:
        return float(np.sum(flow.vorticity()[0] * flow.gamma[0])) * flow.grid.spacing**2 / flow.reynolds

    start, work, dissipated = structure(), 0.0, 0.0
    for _ in range(30):
        rate, power = shape.current[1], dissipation()
        flow.step()
        work += flow.dt * float(flow.last.coefficients @ (rate + shape.current[1])) / 2
        dissipated += 0.5 * flow.dt * (power + dissipation())
    kinetic = 0.5 * float(np.sum(flow.gamma[0] * flow.psi[0])) * flow.grid.spacing**2
    lost = start - structure()
    assert lost == pytest.approx(-work, rel=1e-9)
    # second order in dt, 1.5e-4 and 6e-4 at the two amplitudes
    assert lost == pytest.approx(4.0 * (kinetic + dissipated), rel=2e-3)


@pytest.mark.parametrize("mass_ratio", [0.5, 0.05, 0.0])
def test_coupling_is_stable_for_light_membranes(mass_ratio: float) -> None:
    law = dns.NonlinearTension(stretching=250.0, prestrain=0.002, n_modes=5)
    motion = dns.Motion.sinusoidal(2.0, pitch=math.radians(2.5))
    flow = dns.Simulation(
        dns.Grid.around_plate(cells=16, levels=3),
        dns.Membrane(mass_ratio=mass_ratio, law=law, n_modes=5),
        dt=math.pi / 120,
        motion=motion,
    )
    history = flow.run(math.pi)
    # the third harmonic and beyond stay small: no growing sawtooth from step to step
    late = history.lift[60:]
    assert 0.2 < np.abs(late).max() < 0.8
    assert np.abs(np.diff(late, 3)).max() < 0.01 * np.abs(late).max()
    assert 0.02 < np.abs(history.deflection[:, 0]).max() < 0.06
    assert 0.0 < dns.neglected_inertia(history, motion, mass_ratio) < 1e-3 or mass_ratio == 0.0


def test_step_that_cannot_be_solved_says_so() -> None:
    class Broken:
        """A law that returns no numbers."""

        def restoring(self, deflection: np.ndarray) -> np.ndarray:
            return np.full_like(deflection, np.nan)

        def tangent(self, deflection: np.ndarray) -> np.ndarray:
            return np.eye(deflection.size)

    flow = dns.Simulation(
        dns.Grid.around_plate(cells=16, levels=2), dns.Membrane(mass_ratio=0.5, law=Broken(), n_modes=3)
    )
    with pytest.raises(dns.FlowError, match="smaller dt"):
        flow.step()


def test_law_given_as_a_function_gives_the_same_run() -> None:
    def run(law: dns.ForceLaw) -> dns.History:
        membrane = dns.Membrane(mass_ratio=0.1, law=law, n_modes=4, deflection=np.array([0.05, 0.0, 0.0, 0.0]))
        return dns.Simulation(dns.Grid.around_plate(cells=16, levels=2), membrane, dt=0.02).run(0.2)

    np.testing.assert_allclose(run(dns.Restoring(LAW.restoring)).deflection, run(LAW).deflection, atol=1e-10)


def test_impossible_membranes_are_refused() -> None:
    with pytest.raises(ValueError, match=r"mass_ratio is -0\.1"):
        dns.Membrane(mass_ratio=-0.1, law=LAW, n_modes=4)
    with pytest.raises(ValueError, match="law does not take 7 modes"):
        dns.Membrane(mass_ratio=0.5, law=LAW, n_modes=7)
    with pytest.raises(ValueError, match=r"force of shape \(2,\)"):
        dns.Membrane(mass_ratio=0.5, law=dns.Restoring(lambda _: np.zeros(2)), n_modes=3)
    with pytest.raises(ValueError, match="deflection has shape"):
        dns.Membrane(mass_ratio=0.5, law=LAW, n_modes=4, deflection=np.zeros(3))
    with pytest.raises(ValueError, match="at least four a mode"):
        dns.NonlinearTension(stretching=1.0, prestrain=0.1, n_modes=10, points=20)
    with pytest.raises(ValueError, match=r"between 1 and 6 \(2\.5 cells"):
        dns.Simulation(
            dns.Grid.around_plate(cells=16), dns.Membrane(mass_ratio=0.5, law=dns.LinearTension(1.0), n_modes=10)
        )


def test_force_law_is_that_of_the_models_membrane() -> None:
    """Written twice, as the flow solver takes nothing from the models: same potential, same quadrature."""
    membrane = hbnlp.NonlinearMembrane(stiffness=250.0, prestrain=0.002, n_modes=6, n_nodes=96)
    law = dns.NonlinearTension(stretching=250.0, prestrain=0.002, n_modes=6, points=96)
    deflection = np.array([0.08, -0.03, 0.01, 0.004, -0.002, 0.001])
    np.testing.assert_allclose(law.restoring(deflection), membrane.restoring_force(deflection), rtol=1e-12)
    assert law.strain(deflection) == pytest.approx(membrane.elongation(deflection), rel=1e-12)
    # so either may be given to the flow solver
    adapted = dns.Restoring(membrane.restoring_force)
    np.testing.assert_allclose(adapted.tangent(deflection), law.tangent(deflection), rtol=1e-5, atol=1e-3)
