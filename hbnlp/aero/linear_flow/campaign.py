"""A campaign: the response at many frequencies, resumable, with estimates of its error, in one file."""

from __future__ import annotations

import importlib.metadata
import logging
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hbnlp.aero.frequency_response import FrequencyResponse
from hbnlp.aero.linear_flow.base_flow import steady_flow
from hbnlp.aero.linear_flow.direct import solver_name
from hbnlp.aero.linear_flow.mesh import MeshSettings, check_incidence, half_mesh, slit_mesh
from hbnlp.aero.linear_flow.parts import Parts
from hbnlp.aero.linear_flow.response import LinearResponse
from hbnlp.core.checks import finite_array, instance_of, real_number, whole_number
from hbnlp.core.errors import HbnlpError
from hbnlp.core.kept import Kept
from hbnlp.core.many import each_of
from hbnlp.core.storage import archive_name
from hbnlp.core.types import Array, ComplexArray

logger = logging.getLogger(__name__)

EQUATIONS = (
    "incompressible Navier-Stokes, linearised about the steady flow in arbitrary Lagrangian-Eulerian form, "
    "Taylor-Hood elements on triangles, loads by the reaction of the plate"
)
Progress = Callable[[Iterable[float]], Iterable[float]]
# where unstable eigenvalues are looked for: close together where the stable wake is close to the axis
SHEDDING = (0.3 + 0.7j, 0.3 + 1.1j, 0.3 + 1.5j, 0.3 + 2.0j, 0.3 + 3.0j, 0.3 + 5.0j)


class UnsteadyFlowError(HbnlpError):
    """The steady flow is unstable; ``eigenvalue`` says how."""

    def __init__(self, message: str, eigenvalue: complex) -> None:
        super().__init__(message)
        self.eigenvalue = eigenvalue


@dataclass(frozen=True, kw_only=True)
class Case:
    """What is computed, all but the frequencies.

    Parameters
    ----------
    reynolds : float
        Reynolds number of chord.
    incidence : float
        Angle of the stream to the plate, rad; the half plane is meshed if it is zero, the plane with a slit otherwise.
    n_modes : int
        Number N of sine modes.
    order : int
        Polynomial order of the velocity.
    mesh : MeshSettings

    Raises
    ------
    ValueError
        If the Reynolds number is not positive, the incidence is not within a quarter turn, ``n_modes`` is negative or
        the order below 2.
    """

    reynolds: float = 100.0
    incidence: float = 0.0
    n_modes: int = 20
    order: int = 4
    mesh: MeshSettings = field(default_factory=MeshSettings)

    def __post_init__(self) -> None:
        real_number("reynolds", self.reynolds, above=0.0)
        check_incidence(self.incidence)
        whole_number("n_modes", self.n_modes, least=0)
        whole_number("order", self.order, least=2)
        instance_of("mesh", self.mesh, MeshSettings, "MeshSettings(plate=..., ...)")

    def response(self) -> LinearResponse:
        """Mesh, solve the steady flow, linearise.

        Raises
        ------
        ImportError
            If NGSolve is not installed.
        """
        mesh = (half_mesh if self.incidence == 0.0 else slit_mesh)(self.mesh, incidence=self.incidence)
        flow = steady_flow(mesh, reynolds=self.reynolds, incidence=self.incidence, order=self.order)
        return LinearResponse(flow, n_modes=self.n_modes)

    def variations(self) -> dict[str, Case]:
        """Return the cases whose difference to this one estimates its error: by order, mesh and domain."""
        mesh = self.mesh
        finer = replace(
            mesh, plate=mesh.plate / 1.5, wake=mesh.wake / 1.5, growth=mesh.growth / 1.5, edge=mesh.edge / 16.0
        )
        return {
            "order": replace(self, order=self.order + 1),
            "mesh": replace(self, mesh=finer),
            "domain": replace(self, mesh=replace(mesh, domain=2.0 * mesh.domain)),
        }


def run_campaign(
    path: str | os.PathLike[str],
    *,
    case: Case,
    omega: Sequence[float] | Array,
    probes: Sequence[float] = (),
    progress: Progress = iter,
    executor: Executor | None = None,
) -> FrequencyResponse:
    """Compute the response, the static one included, and write it to ``path``.

    Every finished frequency is kept in the folder ``path.parts`` and not computed again, so an interrupted campaign is
    resumed by the same call. One whose file is damaged is computed again, and a warning that names it is logged. Remove
    the folder when the result is safe.

    Parameters
    ----------
    path : path-like
        The ``.npz`` file to write.
    case : Case
    omega : sequence of float
        Angular frequencies, U/c, above zero.
    probes : sequence of float
        Frequencies at which the error is estimated by repeating the computation with one order more, a finer mesh and
        twice the domain; they must be among ``omega``. None by default.
    progress : callable
        Given the list of frequencies to come, returns an iterable over it; tqdm serves.
    executor : concurrent.futures.Executor, optional
        Of processes, which do the frequencies side by side. Each worker makes the mesh and the steady flow once, and
        has the memory for them.

    Returns
    -------
    FrequencyResponse
        With the provenance: equations, mesh, order, domain, versions, drag, and for each variation the largest relative
        difference of a column at each probe.

    Raises
    ------
    ValueError
        If a frequency is not positive, a probe is not among them, or the folder belongs to another case.
    UnsteadyFlowError
        If the steady flow has an unstable eigenvalue near the frequencies of vortex shedding, `SHEDDING`.
    ConvergenceError
        If the steady flow is not found.
    LoadError
        (A `ValueError`.) If the folder does not say, or no longer, to which case it belongs.
    SaveError
        (An `OSError`.) If a part or the result cannot be written.
    ImportError
        If NGSolve is not installed.
    """
    archive_name("path", path)
    instance_of("progress", progress, Callable, "a function of the frequencies to come, such as tqdm")
    instance_of("executor", executor, Executor | None, "a concurrent.futures.Executor")
    instance_of("case", case, Case, "a Case(reynolds=..., incidence=..., ...)")
    frequencies = np.unique(finite_array("omega", omega, (None,)))
    if frequencies.size == 0 or not frequencies[0] > 0.0:
        raise ValueError(
            f"omega is {omega}; give finite frequencies above zero (the static response is always computed)"
        )
    strange = sorted(set(finite_array("probes", probes, (None,)).tolist()) - set(frequencies.tolist()))
    if strange:
        raise ValueError(f"probes {strange} are not among the frequencies; choose some of omega")
    folder = Path(f"{os.fspath(path)}.parts")
    values, facts = _compute(folder / "main", case, frequencies, progress, executor, refuse_unsteady=True)
    static, dynamic = values[0].real, values[1:]
    estimates: dict[str, dict[str, float]] = {}
    for name, variation in case.variations().items() if len(probes) else ():
        at = np.asarray(sorted(probes), dtype=float)
        other, _ = _compute(folder / name, variation, at, progress, executor, refuse_unsteady=False)
        reference = np.concatenate([values[:1], dynamic[np.searchsorted(frequencies, at)]])
        difference = _column_difference(reference, other)
        estimates[name] = {f"{w:g}": float(d) for w, d in zip((0.0, *at), difference, strict=True)}
    response = FrequencyResponse(
        omega=frequencies, values=dynamic, static=static, base_load=np.asarray(facts.pop("base_load")),
        provenance={
            "source": f"{EQUATIONS}; Re = {case.reynolds:g}, incidence {case.incidence:g} rad, order {case.order}",
            **asdict(case), **facts, "error_estimates": estimates,
            "no_unstable_eigenvalue_near": [[near.real, near.imag] for near in SHEDDING],
        },
    )  # fmt: skip
    response.save(path)
    return response


def _column_difference(reference: ComplexArray, other: ComplexArray) -> Array:
    """Return the largest relative difference of a column, (frequencies,); static heave, which is null, left out."""
    norm = np.linalg.norm(reference, axis=1)
    relative = np.linalg.norm(other - reference, axis=1) / np.where(norm > 0.0, norm, 1.0)
    relative[0, 1] = 0.0
    worst: Array = relative.max(axis=1)
    return worst


def _compute(
    folder: Path, case: Case, omega: Array, progress: Progress, executor: Executor | None, *, refuse_unsteady: bool
) -> tuple[ComplexArray, dict[str, Any]]:
    """Return G at 0 and at ``omega``, (1 + m, N+1, N+2), and the facts of the run; finished parts are read back."""
    parts = Parts(folder, asdict(case), n_modes=case.n_modes)
    facts = parts.facts()
    found = {w: parts.transfer(w) for w in (0.0, *omega.tolist())}
    missing = [w for w, transfer in found.items() if transfer is None]
    if missing or facts is None:
        response = case.response()
        if refuse_unsteady:
            _refuse_unsteady(response, case)
        facts = {
            "drag": response.drag,
            "base_load": response.base_load.tolist(),
            "unknowns": response.unknowns,
            "solver": solver_name(),
            "ngsolve": importlib.metadata.version("ngsolve"),
        }
        parts.keep_facts(facts)

        def take(place: int, transfer: Any) -> None:
            if isinstance(transfer, BaseException):
                raise transfer
            found[missing[place]] = transfer
            parts.keep(missing[place], transfer)

        at = partial(_transfer_at, response) if executor is None else partial(_transfer_there, case)
        with closing(each_of(at, missing, take, executor=executor)) as work:
            for _ in zip(progress(missing), work, strict=True):
                pass
    return np.array(list(found.values())), facts


def _transfer_at(response: LinearResponse, omega: float) -> ComplexArray:
    return response.transfer(1j * omega)


_RESPONSES: Kept[LinearResponse] = Kept(1)


def _transfer_there(case: Case, omega: float) -> ComplexArray:
    """Return the matrix at a frequency, in a process that makes the response of a case once."""
    return _transfer_at(_RESPONSES.get(case, case.response), omega)


def _refuse_unsteady(response: LinearResponse, case: Case) -> None:
    logger.info("base flow: looking for unstable eigenvalues")
    for near in SHEDDING:
        values = response.eigenvalues(near)
        unstable = values[values.real > 0.0]
        if unstable.size:
            rightmost = complex(unstable[unstable.real.argmax()])
            raise UnsteadyFlowError(
                f"the steady flow at Re = {case.reynolds:g}, incidence {np.rad2deg(case.incidence):g} degrees is "
                f"unstable (eigenvalue {rightmost:.4g}): the fluid sheds vortices, and its response is not that about "
                "the steady flow. Lower the Reynolds number or the incidence, or compute the unsteady flow with "
                "hbnlp.dns",
                rightmost,
            )
