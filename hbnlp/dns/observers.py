"""Callbacks for `Simulation.run`: progress bar, saved states, snapshots, and several at once."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from tqdm import tqdm

from hbnlp.core.callbacks import Saving
from hbnlp.core.checks import instance_of, list_of, list_of_callables, real_number, whole_number
from hbnlp.core.storage import archive_name
from hbnlp.core.types import Array
from hbnlp.dns.flow import Callback, Simulation
from hbnlp.dns.storage import save_state

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class ProgressBar:
    """Progress bar up to a time; a context manager and a callback.

    Parameters
    ----------
    until : float
        Time at which the run will end.
    label : str
        Text before the bar.
    """

    def __init__(self, until: float, *, label: str = "flow") -> None:
        self._until = until
        self._label = label
        self._bar: tqdm[Any] | None = None

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()

    def __call__(self, simulation: Simulation) -> None:
        """Move the bar by one step."""
        if self._bar is None:
            left = round((self._until - simulation.time) / simulation.dt) + 1
            self._bar = tqdm(total=left, desc=self._label, unit="step")
        self._bar.update()
        last = simulation.last
        self._bar.set_postfix(t=f"{last.time:.2f}", C_L=f"{last.lift:.4f}", C_D=f"{last.drag:.4f}", refresh=False)


@dataclass(frozen=True)
class Checkpoint:
    """Save the state every so many steps; a save that fails ends no run, and the last one is always a whole file.

    That it failed is logged as a warning, once until a save succeeds; it is tried again when it is time.
    """

    path: str | os.PathLike[str]
    every: int = 500
    _saving: Saving = field(default_factory=Saving, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        archive_name("path", self.path)
        whole_number("every", self.every, least=1)

    def __call__(self, simulation: Simulation) -> None:
        """Save if it is time."""
        if simulation.steps % self.every == 0:
            self._saving(lambda: save_state(simulation, self.path), "a checkpoint", "the run")


@dataclass(frozen=True)
class Snapshot:
    """The flow at one time.

    Parameters
    ----------
    time : float
        Time.
    vorticity : list of ndarray
        Vorticity on the nodes of each level, finest first, shape (nx + 1, ny + 1).
    x, y : list of ndarray
        Positions of these nodes in frame axes, of the same shape (moved by the map where a plate is deflected).
    outline : ndarray of shape (n, 2)
        Body in frame axes.
    pitch, heave : float
        alpha and z of the frame.
    """

    time: float
    vorticity: list[Array]
    x: list[Array]
    y: list[Array]
    outline: Array
    pitch: float
    heave: float

    def plot(self, ax: Axes | None = None, *, limit: float = 5.0) -> Axes:
        """Draw vorticity and body; see `hbnlp.plot.plot_vorticity`."""
        from hbnlp.plot import plot_vorticity

        return plot_vorticity(self, ax, limit=limit)

    @classmethod
    def of(cls, simulation: Simulation) -> Snapshot:
        """Snapshot of a simulation now."""
        grid = simulation.grid
        positions = [np.meshgrid(*grid.nodes(level), indexing="ij") for level in range(grid.levels)]
        y = [part[1] for part in positions]
        y[0] = simulation.node_ordinates()
        return cls(
            time=simulation.time,
            vorticity=list(simulation.vorticity()),
            x=[part[0] for part in positions],
            y=y,
            outline=simulation.wall.outline(simulation.time),
            pitch=simulation.motion.pitch(simulation.time)[0],
            heave=simulation.motion.heave(simulation.time)[0],
        )


@dataclass
class Snapshots:
    """Collect a snapshot every so much time; ``taken`` is the list of them."""

    every: float
    taken: list[Snapshot] = field(default_factory=list)

    def __post_init__(self) -> None:
        real_number("every", self.every, above=0.0)
        advice = "a list of snapshots, to which more are appended"
        instance_of("taken", self.taken, list, advice)
        list_of("taken", self.taken, Snapshot, advice)

    def __call__(self, simulation: Simulation) -> None:
        """Take a snapshot if the last is old enough."""
        # half a step of tolerance: times are sums of dt
        if not self.taken or simulation.time - self.taken[-1].time > self.every - 0.5 * simulation.dt:
            self.taken.append(Snapshot.of(simulation))


def together(*callbacks: Callback) -> Callback:
    """One callback that calls several in order."""
    list_of_callables("callbacks", callbacks)

    def call(simulation: Simulation) -> None:
        for callback in callbacks:
            callback(simulation)

    return call
