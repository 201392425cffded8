"""Linear response by finite elements: what coarse meshes can show (the fine campaign: test_flat_plate)."""

import functools
import json
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from unittest.mock import Mock

import numpy as np
import pytest

from hbnlp.aero.frequency_response import FrequencyResponse
from hbnlp.aero.linear_flow import (
    Case,
    LinearResponse,
    MeshSettings,
    UnsteadyFlowError,
    campaign,
    half_mesh,
    run_campaign,
    slit_mesh,
    steady_flow,
)
from hbnlp.aero.linear_flow import __main__ as command
from hbnlp.aero.linear_flow.__main__ import main
from hbnlp.aero.linear_flow.arnoldi import arnoldi
from hbnlp.aero.linear_flow.campaign import SHEDDING
from hbnlp.aero.linear_flow.direct import factorise
from hbnlp.core.errors import ConvergenceError, LoadError

TINY = MeshSettings(domain=30.0, plate=0.25, wake=2.0, growth=0.7, edge=1e-2)
COARSE = MeshSettings(domain=60.0, plate=0.15, wake=1.0, growth=0.7, edge=1e-4)
# Blasius and Messiter, as in test_flat_plate.py
TRIPLE_DECK_DRAG = 2.0 * (1.328 * 100.0**-0.5 + 2.67 * 100.0 ** (-7.0 / 8.0))


@pytest.fixture(scope="module")
def half():
    return Case(n_modes=2, order=3, mesh=COARSE).response()


@pytest.fixture(scope="module")
def slit():
    flow = steady_flow(slit_mesh(COARSE), reynolds=100.0, order=3)
    return LinearResponse(flow, n_modes=2)


def test_the_direct_solver_solves_real_and_complex_systems():
    import scipy.sparse as sp

    rng = np.random.default_rng(0)
    real = sp.random(300, 300, 0.02, random_state=0, format="csr") + 3.0 * sp.identity(300, format="csr")
    for matrix in (real.tocsr(), (real + 0.5j * real.T).tocsr()):
        right = rng.normal(size=(300, 4))
        with factorise(matrix) as factors:
            np.testing.assert_allclose(matrix @ factors.solve(right), right, atol=1e-11)


def test_drag_is_near_the_triple_deck(half):
    # the next term of the expansion is unknown; known converged value .357, coarse mesh within 2 %
    assert half.drag == pytest.approx(TRIPLE_DECK_DRAG, rel=0.03)


def test_static_heave_gives_no_load(half):
    static = half.transfer(0.0)
    # the whole mesh moves: exact but for rounding
    assert np.abs(static[:, 1]).max() < 1e-10 * np.abs(static[:, 0]).max()


def test_static_response_is_real(half):
    assert np.array_equal(half.transfer(0.0).imag, np.zeros((3, 4)))


def test_conjugate_frequencies_give_conjugate_loads(half):
    np.testing.assert_allclose(half.transfer(-2.0j), half.transfer(2.0j).conj(), rtol=1e-8, atol=1e-8)


def test_slow_heave_velocity_acts_as_minus_pitch(half):
    static = half.transfer(0.0).real
    expected = -static[:, 0]
    expected[0] -= half.drag
    # on the real axis, where the wake's s log s is smallest; its size at s = .002 is about 1 %
    velocity = (half.transfer(0.002) - static)[:, 1].real / 0.002
    np.testing.assert_allclose(velocity, expected, rtol=0.04)


def test_pitch_about_an_axis_is_pitch_about_the_leading_edge_with_heave(monkeypatch):
    """Computed as a motion of its own, with another continuation into the fluid than heave's."""
    import ngsolve

    from hbnlp.aero.linear_flow import motion

    given = motion._displacements

    def with_axis(incidence, n_modes):
        return [*given(incidence, n_modes)[:-1], ngsolve.CF((0.0, 0.4 - ngsolve.x))]

    monkeypatch.setattr(motion, "_displacements", with_axis)
    about_axis = LinearResponse(steady_flow(half_mesh(COARSE), reynolds=100.0, order=3), n_modes=2)
    for s in (0.0, 0.5j, 10.0j):
        # the lift only: the added column passes for that of W_2, whose slope turns the steady friction in dCp
        lift = about_axis.transfer(s)[0]
        # measured 3e-4, the meshes moving differently
        assert lift[3] == pytest.approx(lift[0] + 0.4 * lift[1], rel=1e-3)


def test_half_and_whole_plane_agree(half, slit):
    for s in (0.5j, 20.0j):
        whole, upper = slit.transfer(s), half.transfer(s)
        error = np.linalg.norm(whole - upper, axis=0) / np.linalg.norm(upper, axis=0)
        # the far boundaries differ: closed here, open there for the steady flow, at 60 chords
        assert error.max() < 0.03


def test_added_mass_is_near_the_inviscid_one(half):
    omega = 1000.0
    mass = -(half.transfer(1j * omega) / (1j * omega) ** 2).real
    # inviscid: M_11 = 1.709261, M_22 = .718468 (test_thin_airfoil.py); Stokes layers add some 2 % at this frequency,
    # the coarse mesh as much
    assert mass[1, 2] == pytest.approx(1.709261, rel=0.06)
    assert mass[2, 3] == pytest.approx(0.718468, rel=0.08)


def test_the_coarse_response_is_near_the_shipped_one(half):
    from hbnlp.aero.flat_plate import flat_plate_re100_response

    shipped = flat_plate_re100_response().truncated(2)
    for omega in (1.0, 10.0):
        index = int(np.argmin(np.abs(shipped.omega - omega)))
        coarse = half.transfer(1j * shipped.omega[index])
        error = np.linalg.norm(coarse - shipped.values[index], axis=0) / np.linalg.norm(shipped.values[index], axis=0)
        assert error.max() < 0.05


@pytest.fixture
def one_look_for_shedding(monkeypatch):
    monkeypatch.setattr(campaign, "SHEDDING", SHEDDING[:1])


@pytest.mark.usefixtures("one_look_for_shedding")
def test_a_campaign_is_resumed_without_computing_again(tmp_path, monkeypatch):
    path = tmp_path / "g.npz"
    case = Case(n_modes=1, order=2, mesh=TINY)

    def interrupted(frequencies):
        for count, omega in enumerate(frequencies):
            if count == 2:
                raise KeyboardInterrupt
            yield omega

    with pytest.raises(KeyboardInterrupt):
        run_campaign(path, case=case, omega=[0.5, 2.0, 8.0], progress=interrupted)
    assert not path.exists()
    asked = []

    def recorded(frequencies):
        asked.extend(frequencies)
        return iter(frequencies)

    done = run_campaign(path, case=case, omega=[0.5, 2.0, 8.0], progress=recorded)
    assert asked == [2.0, 8.0]
    loaded = FrequencyResponse.load(path)
    assert np.array_equal(loaded.values, done.values)
    assert loaded.provenance["order"] == 2
    assert loaded.provenance["mesh"]["edge"] == TINY.edge
    assert set(loaded.provenance) >= {"ngsolve", "solver", "drag", "source"}
    # all is there: no mesh, no flow, no solution
    monkeypatch.setattr(Case, "response", None)
    again = run_campaign(path, case=case, omega=[0.5, 2.0, 8.0])
    assert np.array_equal(again.values, done.values)
    with pytest.raises(ValueError, match="belongs to another case"):
        run_campaign(path, case=Case(n_modes=2, order=2, mesh=TINY), omega=[0.5])


@pytest.mark.usefixtures("one_look_for_shedding")
def test_processes_give_the_response_of_a_loop(tmp_path):
    case, omega = Case(n_modes=1, order=2, mesh=TINY), [0.5, 2.0, 8.0]
    loop = run_campaign(tmp_path / "loop.npz", case=case, omega=omega)
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        there = run_campaign(tmp_path / "there.npz", case=case, omega=omega, executor=pool)
    np.testing.assert_allclose(there.values, loop.values, rtol=1e-12)
    np.testing.assert_array_equal(there.static, loop.static)


DAMAGED = {
    "cut off": lambda content: content[: len(content) // 2],
    "empty": lambda content: b"",
    "flipped": lambda content: bytes([*content[:-99], content[-99] ^ 0xFF, *content[-98:]]),
}


@pytest.mark.usefixtures("one_look_for_shedding")
def test_what_is_damaged_of_a_campaign_is_computed_again_and_nothing_else(tmp_path, caplog, monkeypatch):
    path, case, omega = tmp_path / "g.npz", Case(n_modes=1, order=2, mesh=TINY), [0.5, 2.0, 8.0]
    monkeypatch.setattr(Case, "response", functools.cache(Case.response))
    done = run_campaign(path, case=case, omega=omega)
    folder = tmp_path / "g.npz.parts" / "main"
    kept = {file.name: file.read_bytes() for file in folder.iterdir()}
    names = {w: f"omega_{w:.9e}.npz" for w in (0.0, *omega)}
    damages = {"another's": lambda content: kept[names[0.0]]} | DAMAGED
    for damage, (w, file) in zip(damages.values(), reversed(names.items()), strict=True):
        asked = []
        (folder / file).write_bytes(damage(kept[file]))
        caplog.clear()
        again = run_campaign(path, case=case, omega=omega, progress=lambda ws, asked=asked: asked.extend(ws) or ws)
        assert np.array_equal(again.values, done.values)
        assert asked == [w]
        (said,) = [record.message for record in caplog.records if record.levelname == "WARNING"]
        assert "is computed again" in said
        assert file in said
    for damage in DAMAGED.values():
        (folder / "facts.json").write_bytes(damage(kept["facts.json"]))
        assert run_campaign(path, case=case, omega=omega, progress=iter).provenance == done.provenance
    for lost in (lambda file: file.write_text("{"), lambda file: file.unlink()):
        lost(folder / "case.json")
        with pytest.raises(LoadError, match=r"case.json' is damaged or missing.*put it back.* or remove the folder"):
            run_campaign(path, case=case, omega=omega)


def test_the_flow_past_the_plate_is_stable_at_zero_incidence(half):
    for near in SHEDDING[::2]:
        assert np.all(half.eigenvalues(near).real < 0.0)


def test_arnoldis_process_is_exact_on_an_invariant_space():
    values = np.array([3.0, 2.0, 1.0j], dtype=complex)
    np.testing.assert_allclose(arnoldi(lambda x: values * x, np.ones(3, dtype=complex), steps=3), values, atol=1e-12)


def test_isolated_eigenvalues_are_found_beside_a_continuous_spectrum():
    """As of a wake: a row of eigenvalues close together left of the axis, and one that stands alone."""
    spectrum = np.append(-0.05 + 1j * np.linspace(0.0, 3.0, 3000), 0.02 + 1.4j)
    near = 0.3 + 1.5j
    inverse = arnoldi(lambda x: x / (near - spectrum), np.ones(spectrum.size, dtype=complex), steps=40)
    np.testing.assert_allclose(near - 1.0 / inverse, [0.02 + 1.4j], atol=1e-5)


def test_a_flow_that_sheds_vortices_is_refused(tmp_path, monkeypatch):
    """At 30 degrees, where it does at this Reynolds number."""
    monkeypatch.setattr(campaign, "SHEDDING", SHEDDING[2:3])
    case = Case(incidence=np.deg2rad(30.0), n_modes=0, order=3, mesh=COARSE)
    with pytest.raises(UnsteadyFlowError, match=r"30 degrees is unstable.*Lower the Reynolds number") as error:
        run_campaign(tmp_path / "g.npz", case=case, omega=[1.0])
    assert error.value.eigenvalue.real > 0.0
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("one_look_for_shedding")
def test_the_command_runs_a_campaign_and_estimates_its_error(tmp_path):
    path = tmp_path / "g.npz"
    options = "--modes 0 --order 2 --domain 30 --plate .25 --wake 2 --edge 5e-2 --frequencies 2 --lowest 1 --highest 4"
    assert main([str(path), *options.split(), "--probes", "1.1"]) == 0
    response = FrequencyResponse.load(path)
    assert response.omega.tolist() == [1.0, 4.0]
    estimates = response.provenance["error_estimates"]
    assert set(estimates) == {"order", "mesh", "domain"}
    # at rest, and at the frequency nearest to the probe
    assert all(set(at) == {"0", "1"} and 0.0 < at["1"] < 0.2 for at in estimates.values())
    assert json.loads((tmp_path / "g.npz.parts" / "main" / "case.json").read_text())["n_modes"] == 0


def test_an_interrupted_command_says_how_to_resume(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(command, "run_campaign", Mock(side_effect=KeyboardInterrupt))
    assert main([str(tmp_path / "g.npz")]) == 130
    assert "the same command resumes" in caplog.text


def test_a_command_without_the_extra_says_how_to_get_it(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main([str(tmp_path / "g.npz")]) == 1
    assert "pip install 'hbnlp[flow]'" in caplog.text
    with pytest.raises(ImportError, match="pip install"):
        half_mesh(COARSE)


def test_a_command_with_bad_values_ends_with_the_reason_alone(tmp_path, caplog, capsys):
    assert main([str(tmp_path / "g.npz"), "--edge", "1"]) == 1
    assert "0 < edge < plate" in caplog.text
    with pytest.raises(SystemExit):
        main([str(tmp_path / "g.npz"), "--lowest", "0"])
    assert "the static response is always computed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: MeshSettings(edge=1.0), "out of order"),
        (lambda: MeshSettings(wake=0.0), "wake is 0.0; give a finite number greater than 0"),
        (lambda: slit_mesh(TINY, incidence=9.0), "incidence is 9.0; give .* in radians"),
        (lambda: Case(reynolds=0.0), "greater than 0"),
        (lambda: Case(incidence=5.0), "in radians"),
        (lambda: Case(n_modes=-1), "n_modes is -1"),
        (lambda: Case(order=1), "order is 1"),
        (lambda: MeshSettings(growth=2.0), "grading"),
        (
            lambda: steady_flow(half_mesh(COARSE), reynolds=-1.0),
            r"reynolds is -1\.0; .* greater than 0",
        ),
        (lambda: steady_flow(half_mesh(COARSE), reynolds=100.0, order=1), "at least 2"),
        (lambda: steady_flow(half_mesh(COARSE), reynolds=100.0, incidence=0.1), "slit_mesh"),
        (lambda: run_campaign("g.npz", case=Case(), omega=[-1.0]), "above zero"),
        (lambda: run_campaign("g.npz", case=Case(), omega=[1.0], probes=[2.0]), "not among"),
        (lambda: run_campaign("g.npz", case=Case(), omega=[1.0, np.nan]), r"omega\[1\] is nan"),
        (lambda: run_campaign("g.npz", case=Case(), omega=[1.0], probes=["a"]), "probes is"),
        (lambda: run_campaign("g.csv", case=Case(), omega=[1.0]), r"name that ends in \.npz"),
    ],
)
def test_bad_input_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: MeshSettings(plate="a"), "plate is 'a'"),
        (lambda: Case(mesh=3), "mesh is 3; give MeshSettings"),
        (lambda: half_mesh(3), "settings is 3; give MeshSettings"),
        (lambda: steady_flow(3, reynolds=100.0), "mesh is 3; give the mesh of half_mesh"),
        (lambda: LinearResponse(3, n_modes=1), "flow is 3; give the BaseFlow"),
        (lambda: run_campaign("g.npz", case=3, omega=[1.0]), "case is 3; give a Case"),
        (lambda: run_campaign("g.npz", case=Case(), omega=[1.0], progress=3), "progress is 3; give a function"),
    ],
)
def test_wrong_kinds_are_refused(call, message):
    with pytest.raises(TypeError, match=message):
        call()


def test_a_steady_flow_that_is_not_found_is_an_error_with_its_history():
    with pytest.raises(ConvergenceError, match="lower the Reynolds number") as error:
        steady_flow(half_mesh(TINY), reynolds=1e6, order=2)
    assert len(error.value.result) > 1
