"""A branch and its file: saved and loaded, saved on the way, full disks, and its repr."""

import dataclasses
import errno
import logging
import math

import numpy as np
import pytest

from hbnlp.aero import thin_airfoil
from hbnlp.balance.problem import HarmonicBalance
from hbnlp.branches.branch import Branch
from hbnlp.branches.tracing import trace
from hbnlp.core.callbacks import Autosave
from hbnlp.core.errors import SaveError, TaskError
from hbnlp.core.kinds import End, Kind
from hbnlp.core.storage import load_arrays, save_arrays
from hbnlp.systems import chain
from hbnlp.testing import check_branch


def test_a_branch_is_the_same_after_saving_and_loading(branch, tmp_path, assert_same):
    branch.save(tmp_path / "branch.npz")
    loaded = Branch.load(tmp_path / "branch.npz")
    assert_same(branch, loaded)
    check_branch(loaded)
    assert loaded.problem is None
    assert repr(loaded) == repr(branch)


def test_branch_points_neimark_sacker_and_no_stability_survive_the_file(absorber, isola_start, assert_same, tmp_path):
    with_stability = trace(absorber, "omega", (0.5, 3.0), start=isola_start)
    assert {p.kind for p in with_stability.special_points} == {Kind.FOLD, Kind.NEIMARK_SACKER}
    without = trace(HarmonicBalance(chain(3), 3), "omega", (2.5, 0.4), stability=None)
    for branch in (with_stability, without):
        branch.save(tmp_path / "branch.npz")
        assert_same(branch, Branch.load(tmp_path / "branch.npz"))


def test_files_from_before_branch_points_told_what_breaks_load_without_it(tmp_path):
    branch = trace(HarmonicBalance(chain(3), 3), "omega", (2.5, 0.4), stability=None)
    assert all(point.breaks is not None for point in branch.branch_points)
    branch.save(tmp_path / "branch.npz")
    arrays, metadata = load_arrays(tmp_path / "branch.npz", "branch")
    del arrays["special_breaks"]
    for entry in metadata["special_points"]:
        del entry["breaks"]
    save_arrays(tmp_path / "older.npz", "branch", arrays, metadata)
    older = Branch.load(tmp_path / "older.npz")
    assert [point.value for point in older.special_points] == [point.value for point in branch.special_points]
    assert all(point.breaks is None for point in older.special_points)


def test_what_is_no_branch_is_refused(branch, tmp_path):
    with pytest.raises(FileNotFoundError):
        Branch.load(tmp_path / "nothing.npz")
    (tmp_path / "text.npz").write_text("not an archive")
    with pytest.raises(ValueError, match=r"text\.npz.* is not a readable branch file"):
        Branch.load(tmp_path / "text.npz")
    branch.save(tmp_path / "branch.npz")
    whole = (tmp_path / "branch.npz").read_bytes()
    (tmp_path / "half.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"half\.npz.* is not a readable branch file"):
        Branch.load(tmp_path / "half.npz")
    thin_airfoil(2).save(tmp_path / "rom.npz")
    with pytest.raises(ValueError, match=r"rom\.npz.* holds a .*, not a branch"):
        Branch.load(tmp_path / "rom.npz")


def test_a_full_disk_leaves_the_older_file_and_the_branch_as_they_were(branch, tmp_path, monkeypatch, assert_same):
    path = tmp_path / "branch.npz"
    path.write_bytes(b"older")

    def full(handle, **_):
        handle.write(b"part")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("hbnlp.core.storage.np.savez_compressed", full)
    with pytest.raises(
        SaveError, match=r"could not write .*branch\.npz.*No space left on device.*save again"
    ) as caught:
        branch.save(path)
    assert caught.value.errno == errno.ENOSPC
    assert [file.name for file in tmp_path.iterdir()] == ["branch.npz"]
    assert path.read_bytes() == b"older"
    monkeypatch.undo()
    branch.save(path)
    assert_same(branch, Branch.load(path))


# -- saving on the way -------------------------------------------------------------------------------------------------


def test_autosave_on_a_path_that_cannot_be_written_is_logged_and_the_trace_goes_on(
    problem, branch, tmp_path, caplog, assert_same
):
    path = tmp_path / "missing" / "branch.npz"
    with caplog.at_level(logging.WARNING):
        traced = trace(problem, "omega", (0.5, 1.6), callbacks=[Autosave(path, seconds=1e-9)])
    assert_same(traced, branch)
    assert caplog.text.count("autosave failed, tracing omega goes on") == 1
    assert str(path) in caplog.text


def test_autosave_on_a_full_disk_keeps_the_last_good_file(problem, branch, tmp_path, monkeypatch, caplog, assert_same):
    path, save = tmp_path / "branch.npz", np.savez_compressed

    def filling(handle, **arrays):
        if arrays["parameter"].size > 20:
            raise OSError(errno.ENOSPC, "No space left on device")
        save(handle, **arrays)

    monkeypatch.setattr("hbnlp.core.storage.np.savez_compressed", filling)
    traced = trace(problem, "omega", (0.5, 1.6), callbacks=[Autosave(path, seconds=1e-9)])
    assert_same(traced, branch)
    assert "No space left on device" in caplog.text
    kept = Branch.load(path)
    check_branch(kept)
    assert len(kept) == 20
    monkeypatch.undo()
    resumed = trace(problem, "omega", (0.5, 1.6), resume=kept)
    check_branch(resumed)
    np.testing.assert_allclose([f.value for f in resumed.folds], [f.value for f in branch.folds], rtol=1e-11)


def test_numbers_that_are_not_finite_keep_no_branch_from_its_file(branch, tmp_path):
    fold = dataclasses.replace(branch.folds[0], sensitivity={"force": math.nan, "gamma": -math.inf}, value=math.inf)
    residual = np.where(branch.residual == branch.residual.max(), np.nan, branch.residual)
    odd = dataclasses.replace(
        branch, special_points=(fold,), residual=residual, parameters={**branch.parameters, "force": math.nan}
    )
    odd.save(tmp_path / "branch.npz")
    loaded = Branch.load(tmp_path / "branch.npz")
    np.testing.assert_array_equal(loaded.residual, residual)
    assert math.isnan(loaded.parameters["force"])
    assert loaded.folds[0].value == math.inf
    assert math.isnan(loaded.folds[0].sensitivity["force"])


@pytest.mark.parametrize("error", [ValueError("whatever"), MemoryError(), RecursionError(), TypeError("odd")])
def test_whatever_goes_wrong_in_a_save_it_does_not_end_the_trace_and_is_said_once(
    problem, branch, tmp_path, monkeypatch, caplog, assert_same, error
):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr("hbnlp.core.storage.np.savez_compressed", fail)
    with caplog.at_level(logging.WARNING):
        traced = trace(problem, "omega", (0.5, 1.6), callbacks=[Autosave(tmp_path / "branch.npz", seconds=1e-9)])
    assert_same(traced, branch)
    assert caplog.text.count("autosave failed") == 1


def test_autosave_leaves_a_file_that_resumes_after_an_error(problem, tmp_path, raising_at):
    path = tmp_path / "branch.npz"
    with pytest.raises(TaskError):
        trace(problem, "omega", (0.5, 1.6), callbacks=[Autosave(path, seconds=1e-9), raising_at(25, RuntimeError())])
    kept = Branch.load(path)
    assert len(kept) == 25
    resumed = trace(problem, "omega", (0.5, 1.6), resume=kept)
    check_branch(resumed)
    assert resumed.end is End.SPAN_END


# -- what a branch says of itself --------------------------------------------------------------------------------------


def test_the_repr_of_a_branch_is_five_lines_of_facts(branch):
    lines = repr(branch).splitlines()
    assert len(lines) <= 5
    assert "2 folds" in repr(branch)
    assert f"{len(branch)} points, 5 harmonics" in repr(branch)
    assert "reached the end of the span" in repr(branch)


def test_an_unknown_output_of_a_branch_is_refused(branch):
    with pytest.raises(KeyError, match=r"unknown output 'y' \(known: x\)"):
        branch.harmonics("y")
