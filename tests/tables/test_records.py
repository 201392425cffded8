"""Every record as a Dataset, a file of netCDF and a DataFrame holds what the record holds, labelled."""

import re
import sys
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import xarray

import hbnlp
import hbnlp.dns
from hbnlp.fourier import to_complex
from hbnlp.systems import duffing


@pytest.fixture(scope="module")
def branch():
    """Of one to five harmonics, with two folds."""
    problem = hbnlp.HarmonicBalance(duffing(), tolerance=1e-3)
    return hbnlp.trace(problem, "omega", (0.9, 1.5))


@pytest.fixture(scope="module")
def records(branch):
    problem = hbnlp.HarmonicBalance(duffing(), 3)
    wing = hbnlp.membrane_wing(
        hbnlp.LinearMembrane(n_modes=2), hbnlp.aero.thin_airfoil(2), parameters={"pitch_amplitude": 0.1}
    )
    absorber = hbnlp.HarmonicBalance(hbnlp.systems.tuned_absorber(), 2)
    plate = hbnlp.dns.Simulation(hbnlp.dns.Grid.around_plate(cells=8, levels=1), hbnlp.dns.SharpPlate(n_modes=2))
    return {
        "floquet result": hbnlp.floquet(branch.solution(0)),
        "history": plate.run(0.1),
        "branch": branch,
        "branch without stability": hbnlp.trace(problem, "omega", (0.9, 0.95), stability=None),
        "diagram": hbnlp.explore(
            hbnlp.HarmonicBalance(duffing(damping_ratio=0.05, cubic=1.0, force=2.0), tolerance=1e-3),
            "omega",
            (0.5, 1.0),
        ),
        "sweep": hbnlp.sweep(problem, "omega", np.linspace(1.2, 1.4, 11)),
        "sweep by integration": hbnlp.sweep(problem.system, "omega", [0.6, 0.7], max_periods=30),
        "fold curve": hbnlp.follow(branch.folds[0], "force", span=(0.17, 0.19)),
        "solution": hbnlp.solve(absorber, at={"omega": 0.9}),
        "solution set": hbnlp.find_all(problem, at={"omega": 1.2}),
        "time response": hbnlp.integrate(wing, at={"omega": 2.0}, max_periods=20, throw=False),
        "frequency response": hbnlp.aero.flat_plate_re100_response().truncated(1),
        "lift response": hbnlp.lift_response(wing, [0.5, 1.0, 2.0], tensions=[0.6, 1.2]),
    }


KINDS = {
    "floquet result": ("multiplier", {"multipliers", "exponents", "monodromy"}),
    "history": ("time", {"time", "load_time", "lift", "drag", "jump", "jump_modes", "deflection"}),
    "branch": ("point", {"omega", "amplitudes", "displacements", "multipliers", "special_kind"}),
    "branch without stability": ("point", {"omega", "amplitudes", "displacements"}),
    "diagram": ("point", {"omega", "branch", "periods", "amplitudes", "multipliers", "special_branch"}),
    "sweep": ("point", {"omega", "amplitudes", "displacements", "converged", "jumps"}),
    "sweep by integration": ("point", {"omega", "amplitudes", "displacements", "states", "periodic"}),
    "fold curve": ("point", {"omega", "force", "displacements"}),
    "solution": ("harmonic", {"amplitudes", "displacements"}),
    "solution set": ("solution", {"amplitudes", "displacements", "solution_image"}),
    "time response": ("time", {"q", "v", "x", "signals", "defects", "state"}),
    "frequency response": ("omega", {"omega", "values", "static"}),
    "lift response": ("omega", {"omega", "tension", "membrane", "rigid", "growth"}),
}


def test_a_diagram_has_the_points_of_its_branches_one_after_another(records):
    diagram, table = records["diagram"], records["diagram"].to_xarray()
    assert len(diagram) > 1
    assert np.array_equal(np.bincount(table.branch), [len(branch) for branch in diagram.branches])
    for number, branch in enumerate(diagram.branches):
        own = table.isel(point=table.branch.values == number)
        assert np.array_equal(own.omega, branch.parameter)
        most = branch.amplitudes.shape[-1]
        missing = np.arange(most) > branch.n_harmonics[:, None]
        expected = np.where(missing[:, None, :], np.nan, branch.amplitudes)
        assert np.array_equal(own.amplitudes[..., :most], expected, equal_nan=True)
        assert np.isnan(own.amplitudes[..., most:]).all()
        at = table.special_value[table.special_branch.values == number]
        assert np.array_equal(at, [point.value for point in branch.special_points])


def test_a_branch_has_the_dimensions_of_its_arrays_and_its_parameter_along_its_points(branch):
    table = branch.to_xarray()
    assert table.amplitudes.dims == ("point", "output", "harmonic")
    assert table.displacements.dims == ("point", "dof", "harmonic")
    assert table.multipliers.dims == ("point", "multiplier")
    assert table.omega.dims == ("point",)
    assert "omega" in table.coords
    assert "omega" not in table.indexes  # it turns at folds
    np.testing.assert_array_equal(table.omega, branch.parameter)
    assert table.output.values.tolist() == ["x"]
    most = max(branch.n_harmonics.max(), *(point.n_harmonics for point in branch.special_points))
    assert table.harmonic.values.tolist() == list(range(most + 1))


def test_harmonics_that_a_point_does_not_have_are_nan_and_all_others_are_the_record_s(branch):
    table = branch.to_xarray()
    assert branch.n_harmonics.min() < branch.n_harmonics.max()
    for i, n_harmonics in enumerate(branch.n_harmonics):
        solution, row = branch.solution(i), table.isel(point=i)
        np.testing.assert_array_equal(row.amplitudes[:, : n_harmonics + 1], solution.amplitudes)
        np.testing.assert_array_equal(row.displacements[:, : n_harmonics + 1], to_complex(solution.coefficients))
        assert np.isnan(row.amplitudes[:, n_harmonics + 1 :]).all()
        assert np.isnan(row.displacements[:, n_harmonics + 1 :]).all()


def test_special_points_are_rows_of_their_own(branch):
    table = branch.to_xarray()
    assert len(branch.special_points) >= 2
    assert table.special_kind.values.tolist() == [point.kind.value for point in branch.special_points]
    assert table.special_value.values.tolist() == [point.value for point in branch.special_points]
    assert table.special_bracket.sel(side="after").values.tolist() == [p.bracket[1] for p in branch.special_points]
    assert table.special_multiplier.values.tolist() == [point.multiplier for point in branch.special_points]
    for point, row in zip(branch.special_points, table.special_amplitudes.values, strict=True):
        np.testing.assert_array_equal(row[:, : point.n_harmonics + 1], point.solution.amplitudes)
        assert np.isnan(row[:, point.n_harmonics + 1 :]).all()


def test_what_is_not_an_array_is_an_attribute(branch):
    told = branch.to_xarray().attrs
    assert told["kind"] == "branch"
    assert told["hbnlp_version"] == hbnlp.__version__
    assert told["name"] == "omega"
    assert told["system_name"] == branch.system_name
    assert told["message"] == branch.message
    assert {f"parameters_{name}": value for name, value in branch.parameters.items()}.items() <= told.items()
    assert branch.to_xarray().multipliers.attrs["units"] == "1"
    assert "radian" not in told["units"]
    assert "angles in rad" in told["units"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_is_read_by_xarray_alone_and_holds_the_dataset(records, kind, tmp_path):
    record = records[kind]
    table = record.to_xarray()
    assert KINDS[kind][1] <= {*table.variables}
    path = tmp_path / "table.nc"
    record.to_netcdf(path)
    assert [each.name for each in tmp_path.iterdir()] == ["table.nc"]
    with xarray.open_dataset(path) as opened:
        file = opened.load()
    again = {}
    for name, variable in table.variables.items():
        if np.iscomplexobj(variable):
            again[name] = file[f"{name}_re"].variable + 1j * file[f"{name}_im"].variable
        else:
            again[name] = file[name].variable
            assert file[name].attrs == variable.attrs
        assert again[name].dtype.kind == variable.dtype.kind
        assert again[name].dims == variable.dims
        np.testing.assert_array_equal(again[name].values, variable.values)
    assert {*file.coords} == {*table.coords}
    assert file.attrs.keys() == table.attrs.keys()
    for name, value in table.attrs.items():
        np.testing.assert_array_equal(file.attrs[name], value)


@pytest.mark.parametrize("kind", KINDS)
def test_a_data_frame_has_a_row_for_each_point(records, kind):
    record, (rows, _) = records[kind], KINDS[kind]
    frame = record.to_dataframe()
    table = record.to_xarray()
    assert frame.index.name == rows
    assert len(frame) == table.sizes[rows]
    assert frame.attrs == table.attrs
    assert not any(np.iscomplexobj(frame[name]) for name in frame)
    along = [v for n, v in table.variables.items() if rows in v.dims and n != rows]
    sizes = [(2 if np.iscomplexobj(v) else 1) * v.size // v.sizes[rows] for v in along]
    assert frame.shape[1] == sum(sizes)


def test_columns_of_a_data_frame_are_named_by_what_they_are(records):
    branch = records["branch"]
    frame = branch.to_dataframe()
    assert frame.columns[0] == "omega"
    np.testing.assert_array_equal(frame["x_h1_re"] + 1j * frame["x_h1_im"], branch.harmonics("x")[:, 1])
    np.testing.assert_array_equal(frame["multipliers_1_re"], branch.multipliers[:, 1].real)
    np.testing.assert_array_equal(frame["stable"], branch.stable)
    np.testing.assert_array_equal(
        records["time response"].to_dataframe()["C_L"], records["time response"].signal("C_L")
    )
    lift = records["lift response"]
    np.testing.assert_array_equal(lift.to_dataframe()["membrane_1.2_im"], lift.membrane[1].imag)
    found = records["solution set"]
    assert found.to_dataframe()["x_h1_re"].tolist() == [each.harmonics("x")[1].real for each in found]


def test_a_dataset_shares_no_memory_with_the_record(branch):
    kept = branch.parameter.copy(), branch.residual.copy()
    table = branch.to_xarray()
    table.omega.values[:] = 0.0
    table.residual.values[:] = 0.0
    np.testing.assert_array_equal((branch.parameter, branch.residual), kept)


def test_a_record_from_a_file_gives_the_dataset_of_the_record(records, tmp_path):
    for kind, load in {"branch": hbnlp.Branch, "fold curve": hbnlp.FoldBranch, "solution": hbnlp.Solution}.items():
        records[kind].save(tmp_path / "record.npz")
        xarray.testing.assert_identical(load.load(tmp_path / "record.npz").to_xarray(), records[kind].to_xarray())


def test_points_of_several_branches_go_into_one_dataset():
    problem = hbnlp.HarmonicBalance(duffing(), 3)
    sweeps = [hbnlp.sweep(problem, "omega", [0.5, 0.6], at={"force": force}) for force in (0.1, 0.2)]
    study = xarray.concat(
        [each.to_xarray().amplitudes.assign_coords(force=each.parameters["force"]) for each in sweeps], dim="force"
    )
    assert study.sel(force=0.2, output="x").values.tolist() == sweeps[1].harmonics("x").tolist()


@pytest.mark.parametrize("name", ["output", "point", "residual", "harmonic"])
def test_a_parameter_by_the_name_of_something_else_says_so(name):
    system = hbnlp.System(
        1.0, 0.1, 1.0, forcing=lambda tau, p: getattr(p, name) * hbnlp_cos(tau), parameters={name: 0.3, "omega": 0.5}
    )
    problem = hbnlp.HarmonicBalance(system, 1)
    branch = hbnlp.trace(problem, name, (0.3, 0.4), stability=None)
    table = branch.to_xarray()
    np.testing.assert_array_equal(table[f"parameter_{name}"], branch.parameter)
    assert f"parameter_{name}" in branch.to_dataframe()


def hbnlp_cos(tau):
    import casadi as ca

    return ca.cos(tau)


def test_an_output_by_the_name_of_a_column_keeps_both():
    system = hbnlp.System(
        1.0, 0.1, 1.0,
        forcing=lambda tau, p: hbnlp_cos(tau), parameters={"omega": 0.5}, outputs={"q_0": lambda s: 2.0 * s.q[0]},
    )  # fmt: skip
    response = hbnlp.integrate(system, max_periods=2, throw=False)
    frame = response.to_dataframe()
    np.testing.assert_array_equal(frame["q_0"], response.q[:, 0])
    np.testing.assert_array_equal(frame["signals_q_0"], response.signal("q_0"))


@pytest.mark.parametrize(
    ("package", "method"), [("xarray", "to_xarray"), ("pandas", "to_dataframe"), ("h5netcdf", "to_netcdf")]
)
def test_without_a_package_the_error_names_the_extra(branch, package, method, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, package, None)
    given = (tmp_path / "table.nc",) if method == "to_netcdf" else ()
    with pytest.raises(ImportError, match=re.escape(f"needs the package {package!r}, which is not installed: pip")):
        getattr(branch, method)(*given)
    assert [*tmp_path.iterdir()] == []


def test_a_file_that_cannot_be_written_leaves_the_older_one(branch, monkeypatch, tmp_path):
    path = tmp_path / "table.nc"
    branch.to_netcdf(path)
    before = path.read_bytes()

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(xarray.Dataset, "to_netcdf", full)
    with pytest.raises(hbnlp.SaveError, match="No space left on device; nothing was changed there"):
        branch.to_netcdf(path)
    assert path.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == ["table.nc"]


@pytest.mark.parametrize("name", ["table.npz", "table.csv"])
def test_names_of_other_formats_are_refused(branch, name, tmp_path):
    with pytest.raises(ValueError, match=r"a name that ends in \.nc: this writes netCDF"):
        branch.to_netcdf(tmp_path / name)
    with pytest.raises(TypeError, match="the path of a file"):
        branch.to_netcdf(7)


@pytest.mark.parametrize("kind", KINDS)
def test_a_notebook_shows_the_summary_as_a_table(records, kind):
    shown = records[kind]._repr_html_()
    words = "".join(ET.fromstring(shown).itertext())  # noqa: S314  our own
    assert re.sub(r"[\s:]", "", words) == re.sub(r"[\s:]", "", repr(records[kind]))
