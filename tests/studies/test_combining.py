"""Results of many points in one Dataset, labelled by the grid."""

import functools

import numpy as np
import pytest

import hbnlp

xarray = pytest.importorskip("xarray")
OVER = {"damping_ratio": [0.05, 0.06], "force": [0.1, 0.2, 0.3]}


def table(task, over=OVER, extract=None):
    return hbnlp.study(task, over=over).to_xarray(extract)


@pytest.fixture(scope="module")
def branches():
    problem = hbnlp.HarmonicBalance(hbnlp.systems.duffing(), 3)
    return hbnlp.study(functools.partial(hbnlp.trace, problem, "omega", (0.5, 1.6)), over=OVER)


def test_numbers_lie_along_the_grid():
    values = table(lambda at: at["damping_ratio"] * at["force"])
    assert values["result"].dims == ("damping_ratio", "force")
    assert values["result"].sel(damping_ratio=0.06, force=0.2).item() == 0.06 * 0.2
    assert values.attrs["kind"] == "study"


def test_points_of_a_list_are_cases():
    values = table(lambda at: at["n"], [{"n": 1, "model": "a"}, {"n": 2, "model": "b"}])
    assert values["result"].dims == ("case",)
    assert values["result"].dtype.kind == "i"
    assert values["model"].values.tolist() == ["a", "b"]


def test_arrays_of_a_mapping_have_its_names_and_are_padded():
    values = table(lambda at: {"peak": 1.0, "signal": np.ones(at["n"]), "stable": True}, {"n": [2, 3]})
    assert values["signal"].dims == ("n", "signal_0")
    np.testing.assert_array_equal(values["signal"].sel(n=2), [1.0, 1.0, np.nan])
    assert values["stable"].dtype == bool


def test_a_point_that_failed_is_nan_and_says_why():
    def task(at):
        if at["n"] == 2:
            raise ValueError("no")
        return {"whole": at["n"], "complex": 1j, "flag": True, "text": "a"}

    values = table(task, {"n": [1, 2]})
    np.testing.assert_array_equal(values["whole"], [1.0, np.nan])
    assert np.isnan(values["complex"].values[1])
    np.testing.assert_array_equal(values["flag"], [1.0, np.nan])
    assert values["text"].values.tolist() == ["a", ""]
    assert values["error"].values.tolist() == ["", "ValueError: no"]


def test_branches_make_one_dataset_with_the_longest_ones_points(branches, tmp_path):
    values = branches.to_xarray()
    amplitudes = values["amplitudes"]
    assert amplitudes.dims == ("damping_ratio", "force", "point", "output", "harmonic")
    assert values.sizes["point"] == max(map(len, branches))
    one = branches[1, 0]
    part = amplitudes.sel(damping_ratio=0.06, force=0.1, output="x", harmonic=1)
    np.testing.assert_array_equal(part.values[: len(one)], one.harmonics("x")[:, 1])
    assert np.isnan(part.values[len(one) :]).all()
    np.testing.assert_array_equal(values["omega"].values[1, 0, : len(one)], one.values("omega"))
    assert "omega" in values.coords
    assert values.attrs["parameters_cubic"] == one.parameters["cubic"]
    assert "parameters_force" not in values.attrs
    branches.to_netcdf(tmp_path / "study.nc")
    with xarray.open_dataset(tmp_path / "study.nc", engine="h5netcdf") as read:
        np.testing.assert_array_equal(read["amplitudes_re"], amplitudes.real)


def test_extract_makes_of_each_result_what_is_wanted(branches):
    largest = branches.to_xarray(lambda branch: abs(branch.harmonics("x")[:, 1]).max())["result"]
    assert largest.shape == (2, 3)
    assert (np.diff(largest, axis=1) > 0.0).all()


def test_harmonics_of_solutions_that_have_more_are_joined_by_their_number():
    def task(at):
        return hbnlp.solve(hbnlp.HarmonicBalance(hbnlp.systems.duffing(), at["n"]), at={"omega": 0.7, "force": 0.1})

    values = table(task, {"n": [3, 5]})
    assert values["harmonic"].values.tolist() == [0, 1, 2, 3, 4, 5]
    assert np.isnan(values["amplitudes"].sel(n=3, harmonic=5)).all()


def test_a_name_of_the_grid_is_kept_for_the_grid():
    values = table(lambda at: {"force": 1.0, "error": 2.0})
    assert values["result_force"].dims == ("damping_ratio", "force")
    assert "result_error" in values


def test_results_without_a_common_form_are_refused():
    with pytest.raises(ValueError, match="no common form: 'result' is of other dimensions"):
        table(lambda at: np.ones((2,) * at["n"]), {"n": [1, 2]})
    with pytest.raises(TypeError, match="give numbers, texts, arrays, mappings"):
        table(lambda at: object(), {"n": [1]})


def test_a_study_of_which_nothing_is_done_is_a_dataset_of_its_grid():
    def fail(at):
        raise ValueError(at["n"])

    values = table(fail, {"n": [1, 2]})
    assert [*values.data_vars] == ["error"]


@pytest.mark.parametrize("result", [{"n": 1.0, "result_n": 2.0}, {"x": np.ones(2), "x_0": 1.0}])
def test_two_things_of_one_name_are_refused(result):
    with pytest.raises(ValueError, match=r"a result has two things called '(result_n|x_0)'"):
        table(lambda at: result, {"n": [1]})
