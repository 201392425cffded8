"""The membrane's force law and its coupling with the flow."""

import math

import numpy as np
import pytest

import hbnlp
from hbnlp import dns
from hbnlp.dns.membrane import MembraneShape, inertial_load
from hbnlp.dns.plate import PlateWall


def _shape(flow: dns.Simulation) -> MembraneShape:
    assert isinstance(flow.wall, PlateWall)
    assert isinstance(flow.wall.shape, MembraneShape)
    return flow.wall.shape


STRUCTURE = hbnlp.NonlinearMembrane(n_modes=4)


def test_membrane_in_vacuum_keeps_its_energy() -> None:
    membrane = dns.Membrane(STRUCTURE, deflection=np.array([0.08, 0.02, 0.0, 0.0]))
    shape = MembraneShape(membrane, dns.Motion(), 0.02)

    def energy() -> float:
        deflection, rate = shape.current
        return 0.5 * float(rate @ rate) + STRUCTURE.energy(deflection)

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
    membrane = dns.Membrane(STRUCTURE, deflection=np.array([amplitude, 0.0, 0.0, 0.0]))
    flow = dns.Simulation(dns.Grid.around_plate(cells=20, levels=3), membrane, dt=0.01, stream=0.0)
    shape = _shape(flow)

    def structure() -> float:
        deflection, rate = shape.current
        return 0.5 * float(rate @ rate) + STRUCTURE.energy(deflection)

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
    membrane = dns.Membrane(hbnlp.NonlinearMembrane(mass_ratio=mass_ratio, n_modes=5))
    motion = dns.Motion.sinusoidal(2.0, pitch=math.radians(2.5))
    flow = dns.Simulation(
        dns.Grid.around_plate(cells=16, levels=3),
        membrane,
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


class OneMode:
    """A structure of the caller's own: a Duffing oscillator, with what its functions return to be spoilt."""

    mass_ratio, n_modes = 0.5, 1

    def __init__(self, force: np.ndarray | None = None, tangent: np.ndarray | None = None) -> None:
        self._force, self._tangent = force, tangent

    def restoring_force(self, W: np.ndarray) -> np.ndarray:
        return 10.0 * W + 500.0 * W**3 if self._force is None else self._force

    def tangent_stiffness(self, W: np.ndarray) -> np.ndarray:
        return np.diag(10.0 + 1500.0 * W**2) if self._tangent is None else self._tangent


def test_any_structure_may_be_coupled() -> None:
    membrane = dns.Membrane(OneMode(), deflection=np.array([0.05]))
    flow = dns.Simulation(dns.Grid.around_plate(cells=16, levels=2), membrane, dt=0.02, stream=0.0)
    history = flow.run(0.2)
    # released, it moves towards rest, slower than in vacuum
    assert 0.05 * math.cos(0.2 * math.sqrt(11.25)) < history.deflection[-1, 0] < 0.05


def test_step_that_cannot_be_solved_says_so() -> None:
    membrane = dns.Membrane(OneMode(force=np.array([np.nan])))
    flow = dns.Simulation(dns.Grid.around_plate(cells=16, levels=2), membrane)
    with pytest.raises(dns.FlowError, match="smaller dt"):
        flow.step()


def test_impossible_membranes_are_refused() -> None:
    heavy = OneMode()
    heavy.mass_ratio = -0.1
    with pytest.raises(ValueError, match=r"mass_ratio of the structure is -0\.1"):
        dns.Membrane(heavy)
    with pytest.raises(ValueError, match=r"restoring_force of the structure returns the shape \(2,\) for 1 modes"):
        dns.Membrane(OneMode(force=np.zeros(2)))
    with pytest.raises(ValueError, match=r"tangent_stiffness .* the shape \(1,\) for 1 modes; \(1, 1\) is needed"):
        dns.Membrane(OneMode(tangent=np.zeros(1)))
    with pytest.raises(ValueError, match="deflection has shape"):
        dns.Membrane(STRUCTURE, deflection=np.zeros(3))
    with pytest.raises(ValueError, match=r"between 1 and 6 \(2\.5 cells"):
        dns.Simulation(dns.Grid.around_plate(cells=16), dns.Membrane(hbnlp.LinearMembrane()))
