"""Command line: ``python -m hbnlp.aero.linear_flow response.npz`` runs, or resumes, a campaign."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Iterable

import numpy as np
from tqdm import tqdm

from hbnlp.aero.linear_flow.campaign import Case, run_campaign
from hbnlp.aero.linear_flow.extra import require_ngsolve
from hbnlp.aero.linear_flow.mesh import MeshSettings
from hbnlp.core.errors import HbnlpError


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return 0, or 130 after an interrupt."""
    parser = _parser()
    options = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    if options.frequencies < 1 or not 0.0 < options.lowest <= options.highest:
        parser.error("give at least one frequency, and 0 < lowest <= highest; the static response is always computed")
    if not all(probe > 0.0 for probe in options.probes):
        parser.error("probes must be above zero; the static response is always among them")
    omega = np.geomspace(options.lowest, options.highest, options.frequencies)
    probes = np.unique([omega[np.abs(np.log(omega / probe)).argmin()] for probe in options.probes])
    try:
        case = Case(
            reynolds=options.reynolds, incidence=float(np.deg2rad(options.incidence)), n_modes=options.modes,
            order=options.order,
            mesh=MeshSettings(domain=options.domain, plate=options.plate, wake=options.wake, edge=options.edge),
        )  # fmt: skip
        require_ngsolve()
        run_campaign(options.path, case=case, omega=omega, probes=probes.tolist(), progress=_bar)
    except KeyboardInterrupt:
        logging.getLogger(__name__).warning("interrupted; the same command resumes, finished frequencies are kept")
        return 130
    except (HbnlpError, ImportError, ValueError) as error:
        logging.getLogger(__name__).error("%s", error)  # noqa: TRY400 - the message is all that helps
        return 1
    return 0


def _bar(frequencies: Iterable[float]) -> Iterable[float]:
    bar: Iterable[float] = tqdm(frequencies, unit="frequency")
    return bar


def _parser() -> argparse.ArgumentParser:
    defaults, mesh = Case(), MeshSettings()
    parser = argparse.ArgumentParser(prog="python -m hbnlp.aero.linear_flow", description=__doc__)
    parser.formatter_class = argparse.ArgumentDefaultsHelpFormatter
    parser.add_argument("path", help="the .npz file to write; unfinished work is kept in path.parts")
    parser.add_argument("--reynolds", type=float, default=defaults.reynolds, help="Reynolds number of chord")
    parser.add_argument("--incidence", type=float, default=0.0, help="mean incidence, degrees")
    parser.add_argument("--modes", type=int, default=defaults.n_modes, help="membrane modes")
    parser.add_argument("--order", type=int, default=defaults.order, help="polynomial order of the velocity")
    parser.add_argument("--domain", type=float, default=mesh.domain, help="distance of the far field, chords")
    parser.add_argument("--plate", type=float, default=mesh.plate, help="element size on the plate, chords")
    parser.add_argument("--wake", type=float, default=mesh.wake, help="element size in the wake per root of distance")
    parser.add_argument("--edge", type=float, default=mesh.edge, help="element size at the edges, chords")
    parser.add_argument("--lowest", type=float, default=0.01, help="lowest frequency, U/c")
    parser.add_argument("--highest", type=float, default=1000.0, help="highest frequency, U/c")
    parser.add_argument("--frequencies", type=int, default=75, help="number of frequencies, evenly spaced in log")
    parser.add_argument(
        "--probes", type=float, nargs="+", default=[], metavar="OMEGA",
        help="estimate the error by order, mesh and domain at the frequencies nearest to these (slow)",
    )  # fmt: skip
    return parser


if __name__ == "__main__":
    sys.exit(main())
