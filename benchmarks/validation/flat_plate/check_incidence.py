"""Convergence and truth of the finite-element response at an incidence other than zero; print the tables of the docs.

python benchmarks/validation/flat_plate/check_incidence.py FOLDER [--degrees 5]

FOLDER keeps what was computed; the same command goes on from there.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from hbnlp.aero.frequency_response import FrequencyResponse
from hbnlp.aero.linear_flow import Case, MeshSettings, slit_mesh, steady_flow
from hbnlp.aero.linear_flow.loads import base_load

OMEGA = np.array([0.03, 1.0, 30.0])
N_MODES = 10
STEP = np.deg2rad(0.1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--degrees", type=float, default=5.0)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    case = Case(incidence=float(np.deg2rad(options.degrees)), n_modes=N_MODES)
    reference = computed(options.folder / "order 4.npz", case, slow=(0.01, 0.001))
    show_nulls(case, reference)
    show_slope(options.folder / "steady.npy", case, reference)
    for wake in (0.3, 0.12):
        other = replace(case, order=3, mesh=MeshSettings(domain=100.0, plate=0.06, wake=wake, edge=1e-4))
        print(f"order 3, domain 100, plate 0.06, wake {wake}:")
        static = computed(options.folder / f"wake {wake}.npz", other)
        show_slope(options.folder / f"steady wake {wake}.npy", other, static)
    variations = case.variations()
    cases = {"order 3": replace(case, order=3), "order 4": case}
    cases |= {"order 5": variations["order"], "domain": variations["domain"], "mesh": variations["mesh"]}
    for name, other in cases.items():
        show(name, computed(options.folder / f"{name}.npz", other), reference)


def computed(path: Path, case: Case, slow: tuple[float, ...] = ()) -> FrequencyResponse:
    """Return the response of a case at rest and at `OMEGA`, and that to heave growing slowly, like exp(s t)."""
    if path.exists():
        return FrequencyResponse.load(path)
    flow = case.response()
    static = flow.transfer(0.0).real
    slow_heave = {str(s): ((flow.transfer(s) - static)[:, 1].real / s).tolist() for s in slow}
    response = FrequencyResponse(
        omega=OMEGA, values=np.array([flow.transfer(1j * w) for w in OMEGA]), static=static,
        base_load=flow.base_load,
        provenance={"drag": flow.drag, "unknowns": flow.unknowns, "slow_heave": slow_heave},
    )  # fmt: skip
    response.save(path)
    return response


def show(name: str, response: FrequencyResponse, reference: FrequencyResponse) -> None:
    k, load = response.static, response.base_load
    facts = [response.provenance["drag"], *load[:3], k[0, 0], k[1, 0], k[1, 2]]
    print(f"{name}: {response.provenance['unknowns']} unknowns; " + ", ".join(f"{fact:.5f}" for fact in facts))
    columns = np.arange(N_MODES + 2) != 1  # static heave is null
    static = np.linalg.norm(response.static - reference.static, axis=0) / np.linalg.norm(reference.static, axis=0).clip(
        1
    )
    base = np.linalg.norm(load - reference.base_load) / np.linalg.norm(reference.base_load)
    errors = reference.column_errors(response.values)
    print(f"  difference to order 4: base load {base:.1e}; static {static[columns].max():.1e}")
    for w, error in zip(OMEGA, errors, strict=True):
        print(f"  omega {w:g}: largest {error.max():.1e} (motion {error.argmax()}), heave {error[1]:.1e}", flush=True)


def show_nulls(case: Case, response: FrequencyResponse) -> None:
    print(f"incidence {np.rad2deg(case.incidence):g} degrees, C_D, C_L, dCp_1, dCp_2, then per radian C_L, dCp_1,")
    print(f"and dCp_1 per W_1. Static heave: largest load {np.abs(response.static[:, 1]).max():.1e}")
    expected = -response.static[:, 0]
    expected[0] -= response.provenance["drag"]
    for s, slope in response.provenance["slow_heave"].items():
        error = np.linalg.norm(slope - expected) / np.linalg.norm(expected)
        lift = slope[0] / expected[0] - 1.0
        print(f"heave velocity exp(s t) against minus pitch, s = {s}: column {error:.1e}, lift {lift:.1e}")


def show_slope(path: Path, case: Case, response: FrequencyResponse) -> None:
    """Print static pitch against central differences of steady loads."""
    if not path.exists():
        mesh = slit_mesh(case.mesh, incidence=case.incidence)
        angles = case.incidence - STEP, case.incidence + STEP
        flows = (steady_flow(mesh, reynolds=case.reynolds, incidence=a, order=case.order) for a in angles)
        np.save(path, [base_load(flow, N_MODES) for flow in flows])
    low, high = np.load(path)
    difference = (high - low) / (2.0 * STEP)
    error = np.linalg.norm(response.static[:, 0] - difference) / np.linalg.norm(difference)
    print(f"static pitch against central differences of steady loads (0.1 degrees): column {error:.1e}")
    for row, name in enumerate(("C_L", "dCp_1", "dCp_2")):
        print(f"  {name}: {response.static[row, 0]:.6f}, {difference[row]:.6f}", flush=True)


if __name__ == "__main__":
    main()
