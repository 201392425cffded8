"""Histories, frequency response, observers and pictures."""

import dataclasses
import math
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

mpl.use("Agg")

import hbnlp
from hbnlp import dns
from hbnlp.dns.signals import MultiSine
from hbnlp.plot import animate, plot_loads, plot_vorticity


def _membrane_flow() -> dns.Simulation:
    motion = dns.Motion.sinusoidal(2.0, pitch=0.05)
    membrane = dns.Membrane(hbnlp.NonlinearMembrane(n_modes=3))
    return dns.Simulation(dns.Grid.around_plate(cells=16, levels=2), membrane, motion=motion)


def test_history_has_a_row_a_step_and_survives_a_file(tmp_path: Path) -> None:
    flow = _membrane_flow()
    assert repr(flow.history) == "History(no steps)"
    history = flow.run(6 * flow.dt)
    assert history.jump.shape == (6, 16)
    assert history.coefficients.shape == history.deflection.shape == (6, 3)
    np.testing.assert_allclose(history.load_time, history.time - 0.5 * flow.dt)
    dns.save_history(history, tmp_path / "run.npz")
    np.testing.assert_array_equal(dns.load_history(tmp_path / "run.npz").rate, history.rate)
    assert "6 steps" in repr(history)
    # the first version wrote arrays alone
    arrays = {part.name: getattr(history, part.name) for part in dataclasses.fields(history)}
    np.savez(tmp_path / "old.npz", **arrays)
    np.testing.assert_array_equal(dns.load_history(tmp_path / "old.npz").rate, history.rate)
    np.savez(tmp_path / "other.npz", lift=history.lift)
    with pytest.raises(ValueError, match=r"other\.npz' .*it has no 'load_time'"):
        dns.load_history(tmp_path / "other.npz")


def test_harmonics_recovers_amplitudes_and_phases() -> None:
    time = np.linspace(0.0, 2 * math.pi / 0.5, 400, endpoint=False)
    values = 0.3 + 2.0 * np.cos(0.5 * time) - 1.5 * np.sin(2.0 * time)
    np.testing.assert_allclose(dns.harmonics(time, values, np.array([0.5, 2.0])), [2.0, 1.5j], atol=1e-12)


def test_records_too_short_for_the_lowest_frequency_are_refused() -> None:
    time = np.linspace(0.0, 5.0, 100)
    with pytest.raises(ValueError, match="run longer"):
        dns.harmonics(time, time, np.array([0.5]))
    with pytest.raises(ValueError, match="distinct"):
        dns.harmonics(time, time, np.array([2.0, 2.0]))


def test_multi_sine_knows_its_derivatives() -> None:
    signal = MultiSine(np.array([0.3, 2.1]), 0.5, 1.0, 3.0)
    for t in (0.5, 1.7, 3.3, 6.0):
        step = 1e-5
        slope = (signal(t + step)[0] - signal(t - step)[0]) / (2 * step)
        curvature = (signal(t + step)[1] - signal(t - step)[1]) / (2 * step)
        np.testing.assert_allclose(signal(t)[1:], [slope, curvature], atol=1e-8)


@pytest.mark.parametrize("channel", ["pitch", 1])
def test_linear_response_at_high_frequency_approaches_the_added_mass(channel: str | int) -> None:
    grid = dns.Grid.around_plate(cells=20, levels=3)
    steady = dns.Simulation(grid, dns.SharpPlate(n_modes=3), dt=0.01)
    steady.run(1.0)
    column = dns.linear_response(grid, channel, np.array([1, 2]), base=10.0, steady=steady.state(), dt=0.01, n_modes=3)
    load = column.lift if channel == "pitch" else column.coefficients[:, 0]
    inviscid = math.pi / 4 if channel == "pitch" else -1.709261
    # viscous layers and the plate's discrete thickness add to it; both are below a third here
    ratio = load / (-(column.omega**2)) / inviscid
    assert np.all((ratio.real > 0.9) & (ratio.real < 1.35))
    assert column.drift < 0.05


def test_step_response_starts_with_the_added_mass_and_heave_velocity_acts_as_minus_pitch() -> None:
    grid = dns.Grid.around_plate(cells=20, levels=3)
    steady = dns.Simulation(grid, dns.SharpPlate(n_modes=3), dt=0.01)
    steady.run(1.0)
    heave = dns.step_response(grid, "heave", 1.0, steady=steady.state(), dt=0.01, n_modes=3)
    # dCp is -pi/2 per unit acceleration in potential flow; vortex sheets half a cell off the plate add to it
    assert -1.25 < heave.impulse[0] / (math.pi / 2) < -1.0
    np.testing.assert_allclose(np.diff(heave.time), 0.01, rtol=1e-9)
    assert heave.time[0] == pytest.approx(0.015)
    jump = dns.Simulation(grid, dns.SharpPlate(n_modes=3), dt=0.01, motion=dns.Motion(pitch=lambda _: (1e-6, 0.0, 0.0)))
    jump.restore(steady.state())
    pitched = jump.run(2.0)
    # Adams-Bashforth sees the jump half a step late in one and half a step early in the other: a shift by dt
    expected = -1e6 * pitched.coefficients[10:]
    assert np.abs(heave.loads[9:, 1:] - expected).max() < 0.015 * np.abs(expected).max()


def test_unknown_inputs_are_refused() -> None:
    grid = dns.Grid.around_plate(cells=16, levels=1)
    steady = dns.Simulation(grid, dns.SharpPlate()).state()
    for channel, words in (("yaw", "'yaw'"), (20, "channel is 20")):
        with pytest.raises(ValueError, match=words):
            dns.linear_response(grid, channel, np.array([1]), base=1.0, steady=steady)
    with pytest.raises(ValueError, match="whole"):
        dns.linear_response(grid, "pitch", np.array([1.5]), base=1.0, steady=steady)
    with pytest.raises(ValueError, match="periods is 1"):
        dns.linear_response(grid, "pitch", np.array([1]), base=1.0, steady=steady, periods=1.0)


def test_observers_save_collect_and_draw(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flow = _membrane_flow()
    shots = dns.Snapshots(every=2 * flow.dt)
    until = 5 * flow.dt
    with dns.ProgressBar(until) as bar:
        flow.run(until, callback=dns.together(bar, shots, dns.Checkpoint(tmp_path / "state.npz", every=2)))
    assert "5/5" in capsys.readouterr().err
    assert [round(shot.time / flow.dt) for shot in shots.taken] == [1, 3, 5]
    assert (tmp_path / "state.npz").exists()
    axes = plot_vorticity(shots.taken[-1])
    assert axes.get_xlabel() == "$x/c$"
    plot_loads(flow.history)
    animate(shots.taken, tmp_path / "flow.gif")
    assert (tmp_path / "flow.gif").read_bytes()[:3] == b"GIF"
    mpl.pyplot.close("all")
    with pytest.raises(ValueError, match="no snapshots"):
        animate([], tmp_path / "none.gif")
    with pytest.raises(ValueError, match="every is 0"):
        dns.Snapshots(every=0.0)


def test_a_checkpoint_that_fails_ends_no_run_and_is_logged_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    flow, path = _membrane_flow(), tmp_path / "later" / "state.npz"
    checkpoint = dns.Checkpoint(path, every=1)
    assert flow.run(3 * flow.dt, callback=checkpoint).time.size == 3
    assert caplog.text.count("a checkpoint failed, the run goes on") == 1
    path.parent.mkdir()
    flow.run(4 * flow.dt, callback=checkpoint)
    again = _membrane_flow()
    dns.load_state(again, path)
    assert again.time == flow.time
    with pytest.raises(ValueError, match=r"name that ends in \.npz"):
        dns.Checkpoint("state.csv")
