"""The effective ends of the discrete plate: Wiener-Hopf factor of the lattice, a finite plate, and what both give."""

import math

import numpy as np
import pytest
from scipy.special import j0

from hbnlp import dns
from hbnlp.dns import kernels
from hbnlp.dns.grid import PLATE_OVERHANG
from hbnlp.dns.kernels import PLATE_WEIGHTS


def _stokes_response(weights: dict[int, float], q: np.ndarray) -> np.ndarray:
    """Fourier symbol of Stokes flow on the lattice: streamfunction per vorticity source, on the rows of ``weights``.

    For wave number k along the rows a field falls as exp(-q) from row to row, sinh(q / 2) = sin(k / 2). Green's
    function of minus the Laplacian is exp(-q m) / (2 sinh q) for rows m apart, that of its square minus the derivative
    of this with respect to 4 sinh(q / 2)^2.
    """
    total = np.zeros_like(q)
    for row, weight in weights.items():
        for other, factor in weights.items():
            m = abs(row - other)
            total += weight * factor * np.exp(-q * m) * (m + 1.0 / np.tanh(q)) / (4.0 * np.sinh(q) ** 2)
    return total


def overhang(weights: dict[int, float], samples: int = 1 << 14) -> float:
    """Cells by which the discrete plate is shorter than its nodes at an end, as the cell tends to zero.

    The symbol is 1 / (|1 - z|^3 C(z)), z = exp(i k), with C smooth, and that from force to velocity |1 - z|^2 times it.
    Near an end the force at the cell middles n + 1/2 then has the spectrum z^(1/2) (1 - z)^(-1/2) C_+(z), C_+ being the
    factor of C with powers of z from 0 on. To first order in k that is the spectrum of (x - shift)^(-1/2), the shift
    being 1/2 - 1/4 + (d ln C_+ / d ln z at 1).
    """
    k = 2.0 * np.pi * np.arange(samples) / samples
    sine = 2.0 * np.abs(np.sin(k / 2.0))
    sine[0] = sine[1]
    smooth = -np.log(_stokes_response(weights, 2.0 * np.arcsinh(sine / 2.0)) * sine**3)
    smooth[0] = (4.0 * smooth[1] - smooth[2]) / 3.0
    series = np.fft.ifft(smooth).real[1 : samples // 2]
    return float(0.25 + np.arange(1, samples // 2) @ series)


def test_overhang_of_two_rows_is_the_closed_form() -> None:
    # C = (1 - a z)^(1/2) (1 - a / z)^(1/2) up to a factor, a = 3 - 2 sqrt(2)
    assert overhang({0: 0.5, 1: 0.5}) == pytest.approx((2.0 - math.sqrt(2.0)) / 4.0, abs=1e-7)


def test_overhang_of_the_grid_is_that_of_its_interpolation() -> None:
    assert overhang(PLATE_WEIGHTS) == pytest.approx(PLATE_OVERHANG, abs=1e-7)


def test_interpolation_to_the_plate_is_exact_for_cubics() -> None:
    rows = np.array(list(PLATE_WEIGHTS)) - 0.5
    weights = np.array(list(PLATE_WEIGHTS.values()))
    np.testing.assert_allclose([weights @ rows**n for n in range(4)], [1.0, 0.0, 0.0, 0.0], atol=1e-15)


def test_grid_of_the_plate_has_its_end_nodes_outside_the_ends() -> None:
    grid = dns.Grid.around_plate(cells=20)
    x, y = grid.nodes()
    assert grid.plate_cells() == 20
    for end in (-PLATE_OVERHANG * grid.spacing, 1.0 + PLATE_OVERHANG * grid.spacing):
        assert np.abs(x - end).min() < 1e-12
    assert np.abs(y).min() == pytest.approx(0.5 * grid.spacing)


def _third_over_first(cells: int) -> float:
    """Ratio of sine coefficients of the pressure jump on a plate that heaves in Stokes flow."""
    heave = dns.Motion(heave=lambda t: (1e-3 * t, 1e-3, 0.0))
    flow = dns.Simulation(
        dns.Grid.around_plate(cells=cells), dns.SharpPlate(n_modes=3), reynolds=1e-3, dt=0.01, stream=0.0, motion=heave
    )
    flow.run(0.05)
    first, _, third = flow.last.coefficients
    return float(third / first)


# the jump (x (1 - x))^(-1/2) has the sine coefficients pi sin(k pi / 2) J_0(k pi / 2)
STOKES = -j0(1.5 * math.pi) / j0(0.5 * math.pi)


def test_slow_heave_has_the_jump_of_stokes_flow(monkeypatch: pytest.MonkeyPatch) -> None:
    assert _third_over_first(16) == pytest.approx(STOKES, abs=0.003)
    assert _third_over_first(24) == pytest.approx(STOKES, abs=0.003)
    # two rows for v and ends on the nodes: ten times the error
    monkeypatch.setattr(kernels, "PLATE_WEIGHTS", {0: 0.5, 1: 0.5})
    for module in (kernels, dns.grid):
        monkeypatch.setattr(module, "PLATE_OVERHANG", 0.0)
    assert _third_over_first(24) == pytest.approx(STOKES + 0.028, abs=0.001)
