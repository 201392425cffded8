"""The time step as a whole: cylinder, moving bodies, restart, refusals."""

import math
from pathlib import Path

import numpy as np
import pytest

import hbnlp
from hbnlp import dns
from hbnlp.core.errors import SaveError
from hbnlp.dns.bodies import Points


def _coarse_cylinder(**options: object) -> dns.Simulation:
    grid = dns.Grid.box(spacing=1 / 12, x=(-1.0, 2.0), y=(-1.0, 1.0), levels=4)
    return dns.Simulation(grid, dns.circle(grid.spacing), **{"reynolds": 40.0, "dt": 0.025, **options})  # type: ignore[arg-type]


def test_coarse_cylinder_reproduces_its_own_converged_value() -> None:
    history = _coarse_cylinder().run(15.0)
    # the same grid gives 1.5944 at t = 60, with half the time step too; the impulsive start leaves 1.2 % at t = 15. The
    # published 1.50 to 1.54 needs a finer grid (docs/dns.md).
    assert history.drag[-1] == pytest.approx(1.5944, rel=0.02)
    assert np.abs(history.lift).max() < 1e-9


def test_flow_around_a_moving_cylinder_is_that_around_a_fixed_one() -> None:
    points = dns.circle(1 / 12).positions
    body = dns.MovingPoints(
        motion=lambda t: (points + np.array([1.2 - t, 0.0]), np.tile([-1.0, 0.0], (points.shape[0], 1))),
        reach=((-0.2, 1.8), (-0.6, 0.6)),
        closed=True,
    )
    grid = dns.Grid.box(spacing=1 / 12, x=(-1.0, 2.5), y=(-1.0, 1.0), levels=3)
    moving = dns.Simulation(grid, body, reynolds=40.0, dt=0.025, stream=0.0).run(0.8)
    fixed = dns.Simulation(grid, dns.circle(1 / 12, centre=(0.5, 0.0)), reynolds=40.0, dt=0.025).run(0.8)
    # points pass through the cells: the kernel's error of first order in h, 2.1 % here
    window = slice(16, None)
    assert moving.drag[window].mean() == pytest.approx(fixed.drag[window].mean(), rel=0.03)
    assert np.abs(moving.lift).max() < 1e-8


def test_load_on_an_accelerated_cylinder_is_its_added_mass() -> None:
    """A sudden velocity U gives the impulse of the added mass pi/4 D^2 U, that of the fluid inside taken off."""
    impulses = []
    for cells in (16, 32):
        points = dns.circle(1 / cells, ratio=1.0).positions

        def motion(t: float, points: np.ndarray = points) -> tuple[np.ndarray, np.ndarray]:
            moved = max(t, 0.0)
            return points + np.array([moved, 0.0]), np.tile([1.0 if t > 0.5e-4 else 0.0, 0.0], (points.shape[0], 1))

        grid = dns.Grid.box(spacing=1 / cells, x=(-1.0, 1.0), y=(-1.0, 1.0), levels=4)
        body = dns.MovingPoints(motion=motion, reach=((-0.52, 0.52), (-0.52, 0.52)), closed=True)
        flow = dns.Simulation(grid, body, reynolds=1000.0, dt=1e-4, stream=0.0)
        flow.step()
        impulses.append(-0.5 * flow.last.drag * flow.dt)
    # the regularised vortex sheet is wider than the surface by a fraction of a cell: first order, 20 % at h = 1/32
    assert impulses[1] - math.pi / 4 < 0.55 * (impulses[0] - math.pi / 4)
    assert 2 * impulses[1] - impulses[0] == pytest.approx(math.pi / 4, rel=0.04)


@pytest.mark.parametrize("kind", ["cylinder", "plate", "membrane"])
def test_restart_continues_bit_for_bit(kind: str, tmp_path: Path) -> None:
    def build() -> dns.Simulation:
        if kind == "cylinder":
            return _coarse_cylinder()
        grid = dns.Grid.around_plate(cells=16, levels=3)
        motion = dns.Motion.sinusoidal(2.0, pitch=0.05)
        if kind == "plate":
            return dns.Simulation(grid, dns.SharpPlate.oscillating(2.0, np.array([0.05])), motion=motion)
        return dns.Simulation(grid, dns.Membrane(hbnlp.NonlinearMembrane(n_modes=3)), motion=motion)

    whole, first, second = build(), build(), build()
    for _ in range(12):
        whole.step()
    for _ in range(7):
        first.step()
    dns.save_state(first, tmp_path / "state.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["state.npz"]
    dns.load_state(second, tmp_path / "state.npz")
    for _ in range(5):
        second.step()
    assert second.time == whole.time
    np.testing.assert_array_equal(second.psi, whole.psi)
    np.testing.assert_array_equal(second.gamma, whole.gamma)
    np.testing.assert_array_equal(second.history.lift, whole.history.lift[7:])


def test_states_saved_as_arrays_alone_are_continued(tmp_path: Path) -> None:
    """The first version wrote no kind and no metadata."""
    flow, other = _coarse_cylinder(), _coarse_cylinder()
    flow.run(0.1)
    np.savez(tmp_path / "state.npz", **flow.state())
    dns.load_state(other, tmp_path / "state.npz")
    np.testing.assert_array_equal(other.run(0.2).lift, flow.run(0.2).lift[4:])


def test_state_is_not_touched_by_the_steps_after_it() -> None:
    flow = _coarse_cylinder()
    flow.run(0.1)
    state, then = flow.state(), flow.psi.copy()
    flow.run(0.2)
    np.testing.assert_array_equal(state["psi"], then)
    flow.restore(state)
    assert flow.time == pytest.approx(0.1)


def test_plate_may_start_to_move_from_a_saved_steady_flow() -> None:
    grid = dns.Grid.around_plate(cells=16, levels=3)
    steady = dns.Simulation(grid, dns.SharpPlate())
    steady.run(40 * steady.dt)
    start = steady.time
    moving = dns.Simulation(
        grid,
        dns.SharpPlate(
            deflection=lambda t: (np.array([0.1 * (t - start) ** 2]), np.array([0.2 * (t - start)])), n_modes=1
        ),
    )
    moving.restore(steady.state())
    assert moving.time == pytest.approx(start)
    history = moving.run(start + 10 * moving.dt)
    # no jump of the drag when the deflection starts at rest
    assert history.drag[0] == pytest.approx(steady.last.drag, rel=0.01)


def test_too_large_a_step_is_refused_with_one_that_would_do() -> None:
    with pytest.raises(dns.FlowError, match=r"limit 0\.8: dt = 0\.\d+ would do"):
        _coarse_cylinder(dt=0.1)
    flow = _coarse_cylinder(dt=0.06)
    with pytest.raises(dns.FlowError, match="Courant"):
        flow.run(3.0)


def test_points_closer_than_the_grid_allows_are_refused() -> None:
    grid = dns.Grid.box(spacing=1 / 12, levels=2)
    points = dns.circle(grid.spacing).positions
    doubled = Points(np.vstack([points, points + 1e-9]), closed=True)
    with pytest.raises(dns.FlowError, match="closer together than the grid resolves"):
        dns.Simulation(grid, doubled)


def test_bodies_outside_the_fine_box_are_refused() -> None:
    grid = dns.Grid.box(spacing=1 / 12, levels=2)
    with pytest.raises(ValueError, match="enlarge the box"):
        dns.Simulation(grid, dns.circle(grid.spacing, centre=(1.6, 0.0)))
    body = dns.MovingPoints(
        motion=lambda t: (np.array([[0.0, 4 * t], [0.1, 4 * t]]), np.array([[0.0, 4.0], [0.0, 4.0]])),
        reach=((-0.2, 0.3), (-0.2, 0.2)),
    )
    flow = dns.Simulation(grid, body, dt=0.01)
    with pytest.raises(ValueError, match="leaves its reach"):
        flow.run(0.5)


def test_plate_on_a_grid_that_does_not_suit_it_is_refused() -> None:
    with pytest.raises(ValueError, match="around_plate"):
        dns.Simulation(dns.Grid.box(spacing=0.05, levels=1), dns.SharpPlate())


def test_deflection_too_large_for_the_map_is_refused() -> None:
    flow = dns.Simulation(
        dns.Grid.around_plate(cells=16, levels=2), dns.SharpPlate.oscillating(2.0, np.array([0.5])), dt=0.01
    )
    with pytest.raises(dns.FlowError, match="too steep"):
        flow.run(2.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [({"reynolds": 0.0}, "reynolds is 0.0"), ({"reynolds": math.nan}, "reynolds"), ({"dt": -1.0}, "dt is -1.0")],
)
def test_impossible_parameters_are_refused(options: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        _coarse_cylinder(**options)


def test_impossible_grids_are_refused() -> None:
    with pytest.raises(ValueError, match="spacing is -1"):
        dns.Grid(spacing=-1.0, shape=(20, 20), corner=(0.0, 0.0))
    with pytest.raises(ValueError, match="from 16"):
        dns.Grid(spacing=1.0, shape=(20, 8), corner=(0.0, 0.0))
    with pytest.raises(ValueError, match="levels is 0"):
        dns.Grid(spacing=1.0, shape=(20, 20), corner=(0.0, 0.0), levels=0)
    with pytest.raises(ValueError, match="the lower one first"):
        dns.Grid.box(spacing=0.1, x=(1.0, 0.0))
    with pytest.raises(ValueError, match="cells is 2"):
        dns.Grid.around_plate(cells=2)


def test_states_of_other_grids_and_broken_files_are_refused(tmp_path: Path) -> None:
    flow = _coarse_cylinder()
    other = dns.Simulation(dns.Grid.box(spacing=0.1, levels=4), dns.circle(0.1), dt=0.03)
    with pytest.raises(ValueError, match="belongs to a grid"):
        other.restore(flow.state())
    with pytest.raises(ValueError, match="lacks"):
        flow.restore({"psi": flow.psi})
    broken = tmp_path / "broken.npz"
    broken.write_bytes(b"PK\x03\x04 no archive")
    with pytest.raises(ValueError, match=r"broken\.npz' is not a readable flow state"):
        dns.load_state(flow, broken)
    dns.save_history(flow.history, broken)
    with pytest.raises(ValueError, match="holds a flow history, not a flow state"):
        dns.load_state(flow, broken)
    with pytest.raises(SaveError, match="nowhere"):
        dns.save_state(flow, tmp_path / "nowhere" / "state.npz")


def test_times_already_passed_are_refused() -> None:
    flow = _coarse_cylinder()
    flow.run(0.1)
    with pytest.raises(ValueError, match="the flow is there already"):
        flow.run(0.05)
