"""Operators of the flow solver against identities that hold to round-off, and orders against theory."""

import numpy as np
import pytest

from hbnlp.dns.grid import Grid
from hbnlp.dns.kernels import Window, hat, point_coupling, roma, sharp_plate_coupling
from hbnlp.dns.mapping import PlateMap
from hbnlp.dns.nested import NestedSolver, sine_transform
from hbnlp.dns.stencils import advection, curl, laplacian, node_velocity, rot

RNG_SEED = 20


def _interior(field: np.ndarray) -> np.ndarray:
    return field[1:-1, 1:-1]


def _zero_border(field: np.ndarray) -> np.ndarray:
    return np.pad(_interior(field), 1)


def test_rot_is_the_adjoint_of_curl() -> None:
    rng = np.random.default_rng(RNG_SEED)
    psi = _zero_border(rng.standard_normal((13, 10)))
    u, v = rng.standard_normal((13, 9)), rng.standard_normal((12, 10))
    cu, cv = curl(psi, 0.3)
    assert np.sum(cu * u) + np.sum(cv * v) == pytest.approx(np.sum(_interior(psi) * rot(u, v, 0.3)), rel=1e-12)


def test_rot_of_curl_is_minus_the_laplacian() -> None:
    psi = np.random.default_rng(RNG_SEED).standard_normal((13, 10))
    np.testing.assert_allclose(rot(*curl(psi, 0.2), 0.2), -laplacian(psi, 0.2), atol=1e-11)


def test_advection_conserves_circulation_and_enstrophy() -> None:
    rng = np.random.default_rng(RNG_SEED)
    psi, omega = (np.pad(rng.standard_normal((8, 6)), 3) for _ in range(2))
    out = advection(*node_velocity(psi, 0.1), omega, 0.1)
    scale = np.abs(out).sum()
    assert abs(out.sum()) < 1e-13 * scale
    assert abs(np.sum(out * _interior(omega))) < 1e-12 * scale


def test_advection_is_second_order() -> None:
    errors = []
    for n in (16, 32, 64):
        h = 1.0 / n
        x, y = np.meshgrid(*(np.arange(n + 1) * h,) * 2, indexing="ij")
        psi, omega = np.sin(2 * x + y), np.cos(x - 3 * y)
        exact = -np.cos(2 * x + y) * -np.sin(x - 3 * y) + 2 * np.cos(2 * x + y) * 3 * np.sin(x - 3 * y)
        errors.append(np.abs(advection(*node_velocity(psi, h), omega, h) - _interior(exact)).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.15)


@pytest.mark.parametrize("shape", [(20, 17), (24, 16)])
def test_single_wavenumber_is_solved_exactly(shape: tuple[int, int]) -> None:
    grid = Grid(spacing=0.1, shape=shape, corner=(0.0, 0.0), levels=1)
    nested = NestedSolver(grid, diffusion := 0.004)
    x, y = grid.nodes()
    mode = np.outer(np.sin(3 * np.pi * x / x[-1]), np.sin(2 * np.pi * y / y[-1]))
    symbol = sum(4 / 0.1**2 * np.sin(0.5 * np.pi * m / n) ** 2 for m, n in ((3, shape[0]), (2, shape[1])))
    solution = nested.solve(sine_transform(_interior(mode)[None]))
    gamma = sine_transform(solution.gamma[0])
    np.testing.assert_allclose(gamma, _interior(mode) / (1 + 0.5 * diffusion * symbol), atol=1e-14)
    np.testing.assert_allclose(sine_transform(solution.psi[0]), gamma / symbol, atol=1e-14)


@pytest.mark.parametrize("shape", [(24, 17), (30, 20), (21, 19)])
def test_restriction_keeps_circulation_and_its_moments(shape: tuple[int, int]) -> None:
    grid = Grid(spacing=0.1, shape=shape, corner=(-1.0, -0.7), levels=2)
    nested = NestedSolver(grid, 0.001)
    fields = np.zeros((2, shape[0] - 1, shape[1] - 1))
    fields[0, 6:-6, 5:-5] = np.random.default_rng(RNG_SEED).standard_normal(fields[0, 6:-6, 5:-5].shape)
    nested.restrict_all(fields)
    for power_x, power_y in ((0, 0), (1, 0), (0, 1)):
        moments = []
        for level in (0, 1):
            x, y = (axis[1:-1] for axis in grid.nodes(level))
            moments.append(grid.cell(level) ** 2 * (x**power_x @ fields[level] @ y**power_y))
        assert moments[1] == pytest.approx(moments[0], abs=1e-13)


@pytest.mark.parametrize("ny", [48, 49])
def test_nested_poisson_converges_to_a_gaussian_vortex(ny: int) -> None:
    errors = []
    for refine in (1, 2):
        n = refine * 48
        grid = Grid(
            spacing=2.0 / n, shape=(n, refine * ny if ny % 2 == 0 else refine * 48 + 1), corner=(-1.0, -1.0), levels=5
        )
        nested = NestedSolver(grid, 1e-12)
        radius = 0.25
        gamma = []
        for level in range(grid.levels):
            x, y = np.meshgrid(*(axis[1:-1] for axis in grid.nodes(level)), indexing="ij")
            gamma.append(np.exp(-(x**2 + y**2) / radius**2) / (np.pi * radius**2))
        fields = np.array(gamma)
        nested.restrict_all(fields)
        solution = nested.solve([sine_transform(level) for level in fields], circulation=1.0)
        psi = np.empty((grid.shape[0] + 1, grid.shape[1] + 1))
        nested.to_nodes(solution.psi[0], solution.psi_edges[0], psi)
        u, _ = node_velocity(psi, grid.spacing)
        x, y = np.meshgrid(grid.nodes()[0], grid.nodes()[1][1:-1], indexing="ij")
        r2 = np.maximum(x**2 + y**2, 1e-30)
        errors.append(np.abs(u + y / (2 * np.pi * r2) * (1 - np.exp(-r2 / radius**2))).max())
    # second order in h; the far field of a single vortex is that of the boundary value
    assert errors[1] < 0.3 * errors[0]
    assert errors[1] < 0.004


@pytest.mark.parametrize("kernel", [roma, hat])
def test_interpolation_is_exact_for_linear_velocities(kernel: object) -> None:
    grid = Grid(spacing=0.05, shape=(40, 41), corner=(-1.0, -1.0), levels=1)
    points = np.random.default_rng(RNG_SEED).uniform(-0.5, 0.5, (30, 2))
    window = Window.around(grid, points)
    coupling = point_coupling(grid, points, window, kernel)  # type: ignore[arg-type]
    x, y = np.meshgrid(*grid.nodes(), indexing="ij")
    psi = 0.3 * y - 0.7 * x + 0.2 * (x**2 + y**2)
    values = coupling.velocities(psi[window.full]).reshape(2, -1)
    np.testing.assert_allclose(values[0], 0.3 + 0.4 * points[:, 1], atol=1e-12)
    np.testing.assert_allclose(values[1], 0.7 - 0.4 * points[:, 0], atol=1e-12)


def test_regularisation_is_the_adjoint_of_interpolation_and_carries_the_force() -> None:
    grid = Grid.around_plate(cells=16, levels=1)
    rng = np.random.default_rng(RNG_SEED)
    plate = sharp_plate_coupling(grid)[0]
    points = rng.uniform(-0.3, 0.3, (7, 2)) + np.array([0.5, 0.0])
    for coupling in (plate, point_coupling(grid, points, Window.around(grid, points))):
        psi, force = rng.standard_normal(coupling.window.shape), rng.standard_normal(coupling.matrix.shape[0])
        source = coupling.source(force, grid.spacing)
        assert coupling.velocities(psi) @ force == pytest.approx(grid.spacing**2 * np.sum(psi * source), rel=1e-12)
        # impulse of the vorticity source: the integral of (y, -x) times it is the force
        x, y = (axis[part] for axis, part in zip(grid.nodes(), coupling.window.full, strict=True))
        n_u = plate.matrix.shape[0] // 2 if coupling is plate else 7
        total = grid.spacing**2 * np.array([np.sum(source * y[None, :]), -np.sum(source * x[:, None])])
        np.testing.assert_allclose(total, [force[:n_u].sum(), force[n_u:].sum()], atol=1e-11)


def test_metric_of_no_deflection_is_the_identity_and_of_any_is_symmetric() -> None:
    grid = Grid.around_plate(cells=16, levels=1, above=1.03)
    plate_map = PlateMap(grid, 3)
    flat = plate_map.metric(np.zeros(3), np.zeros(3))
    rng = np.random.default_rng(RNG_SEED)
    shape = flat.eta.shape
    assert np.abs(flat.source(rng.standard_normal(shape))).max() < 1e-10
    bent = plate_map.metric(np.array([0.08, 0.03, -0.01]), np.zeros(3))
    one, two = (np.pad(rng.standard_normal((shape[0] - 4, shape[1] - 4)), 2) for _ in range(2))
    first, second = np.sum(_interior(one) * bent.rotation(two)), np.sum(_interior(two) * bent.rotation(one))
    assert first == pytest.approx(second, rel=1e-11)


def test_mapped_laplacian_is_second_order() -> None:
    errors = []
    for cells in (16, 32, 64):
        grid = Grid.around_plate(cells=cells, levels=1, above=1.03)
        plate_map = PlateMap(grid, 2)
        metric = plate_map.metric(np.array([0.1, 0.03]), np.zeros(2))
        x = plate_map.x[:, None]
        y = plate_map.y[None, :] + metric.eta
        psi = np.sin(2 * x) * np.cos(3 * y)
        # -J Lap psi, with the Laplacian in physical coordinates known in closed form
        exact = _interior(metric.jacobian * 13.0 * psi)
        away = 2
        errors.append(np.abs(metric.rotation(psi) - exact)[away:-away, away:-away].max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.25)
