"""One-file storage: what goes in comes out, or the old file stays as it was."""

import errno
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hbnlp.core.errors import SaveError
from hbnlp.core.storage import load_arrays, save_arrays

json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**53), 2**53)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    array=hnp.arrays(st.sampled_from([float, complex, bool, np.int64]), hnp.array_shapes(min_dims=0, min_side=0)),
    metadata=json_values,
)
def test_arrays_and_metadata_come_back_as_they_were(tmp_path, array, metadata):
    save_arrays(tmp_path / "file", "thing", {"a": array}, {"m": metadata})
    arrays, found = load_arrays(tmp_path / "file", "thing")
    np.testing.assert_array_equal(arrays["a"], array)
    assert arrays["a"].dtype == array.dtype
    assert found == {"m": metadata}


def test_nothing_is_pickled(tmp_path):
    with pytest.raises(TypeError, match="'a' holds Python objects"):
        save_arrays(tmp_path / "file", "thing", {"a": np.array([{}])}, {})
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_keeps_the_old_file_and_leaves_no_litter(tmp_path, monkeypatch):
    path = tmp_path / "file.npz"
    save_arrays(path, "thing", {"a": np.arange(3)}, {})

    def full(handle, **_):
        handle.write(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(SaveError, match=r"file\.npz.*No space left.*save again") as caught:
        save_arrays(path, "thing", {"a": np.arange(4)}, {})
    assert caught.value.errno == errno.ENOSPC
    assert isinstance(caught.value, OSError)
    assert list(tmp_path.iterdir()) == [path]
    np.testing.assert_array_equal(load_arrays(path, "thing")[0]["a"], np.arange(3))


def test_an_interrupt_keeps_the_old_file_and_leaves_no_litter(tmp_path, monkeypatch):
    path = tmp_path / "file.npz"
    save_arrays(path, "thing", {"a": np.arange(3)}, {})
    monkeypatch.setattr(np, "savez_compressed", lambda *_, **__: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        save_arrays(path, "thing", {"a": np.arange(4)}, {})
    assert list(tmp_path.iterdir()) == [path]


def test_processes_that_save_to_the_same_file_at_the_same_time_leave_a_whole_one(tmp_path):
    path, size = tmp_path / "file.npz", 100_000
    # noise, so that a save takes long enough to meet another
    noise = np.random.default_rng(0).standard_normal(size)
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        saves = [
            pool.submit(save_arrays, path, "thing", {"a": noise, "b": np.full(size, i)}, {"i": i}) for i in range(40)
        ]
        while not all(save.done() for save in saves):
            if path.exists():
                arrays, metadata = load_arrays(path, "thing")
                np.testing.assert_array_equal(arrays["b"], metadata["i"])
        assert [save.result() for save in saves] == [None] * 40
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_is_missing_is_named(tmp_path):
    with pytest.raises(SaveError, match="nowhere"):
        save_arrays(tmp_path / "nowhere" / "file", "thing", {}, {})


def test_files_that_are_something_else_are_refused(tmp_path):
    path = tmp_path / "file"
    with pytest.raises(FileNotFoundError):
        load_arrays(path, "thing")
    save_arrays(path, "thing", {}, {})
    with pytest.raises(ValueError, match="holds a thing, not a Branch"):
        load_arrays(path, "Branch")
    for content in (b"", b"text", path.read_bytes()[:-30], pickle.dumps([1, 2])):
        path.write_bytes(content)
        with pytest.raises(ValueError, match="not a readable thing file"):
            load_arrays(path, "thing")
    np.savez(tmp_path / "other.npz", a=1)
    with pytest.raises(ValueError, match="not a readable thing file"):
        load_arrays(tmp_path / "other.npz", "thing")
    np.save(tmp_path / "other.npy", 1)
    with pytest.raises(ValueError, match="not a readable thing file"):
        load_arrays(tmp_path / "other.npy", "thing")


def test_whatever_byte_of_a_file_is_changed_no_other_numbers_come_out(tmp_path):
    path, array = tmp_path / "file", np.random.default_rng(0).standard_normal(30)
    save_arrays(path, "thing", {"a": array}, {})
    content = path.read_bytes()
    refused = 0
    for place in range(len(content)):
        damaged = bytearray(content)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        # dates and the like may change without loss, and the archive's list of its parts may become shorter
        with suppress(ValueError):
            np.testing.assert_array_equal(load_arrays(path, "thing")[0].get("a", array), array)
            continue
        refused += 1
    assert refused > 0.5 * len(content)


def test_arrays_alone_are_taken_where_they_will_do_and_what_says_its_kind_is_held_to_it(tmp_path):
    np.savez(tmp_path / "plain.npz", a=np.arange(3))
    arrays, metadata = load_arrays(tmp_path / "plain.npz", "thing", plain=True)
    np.testing.assert_array_equal(arrays["a"], np.arange(3))
    assert metadata == {}
    save_arrays(tmp_path / "branch.npz", "Branch", {"a": np.arange(3)}, {})
    with pytest.raises(ValueError, match="holds a Branch, not a thing"):
        load_arrays(tmp_path / "branch.npz", "thing", plain=True)
