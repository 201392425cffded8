"""Files of every kind of record: those of earlier versions load, and what is damaged is one error or the same."""

import dataclasses
import io
import json
import os
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import hbnlp
from hbnlp import dns
from hbnlp.aero import AeroROM, FrequencyResponse
from hbnlp.core import storage
from hbnlp.core.errors import LoadError
from hbnlp.core.storage import load_arrays, save_arrays

FILES = {path.stem: path for path in sorted((Path(__file__).parents[1] / "data").glob("format_*/*.npz"), reverse=True)}
"""Of each kind of record the oldest: format 0 was written before files had a number of their format."""


def flow():
    return dns.Simulation(dns.Grid.around_plate(cells=16, levels=1), dns.Membrane(hbnlp.NonlinearMembrane(n_modes=3)))


class State:
    """A flow's state with the two verbs of a record."""

    simulation = None

    @classmethod
    def load(cls, path):
        cls.simulation = cls.simulation or flow()
        dns.load_state(cls.simulation, path)
        return cls.simulation.state()

    @classmethod
    def save(cls, path):
        dns.save_state(cls.simulation, path)


LOADERS = {
    "branch": hbnlp.Branch.load,
    "branch_points": hbnlp.Branch.load,
    "branch_to_a_tolerance": hbnlp.Branch.load,
    "fold_curve": hbnlp.FoldBranch.load,
    "sweep": hbnlp.Sweep.load,
    "time_sweep": hbnlp.TimeSweep.load,
    "rom": AeroROM.load,
    "frequency_response": FrequencyResponse.load,
    "solution": hbnlp.Solution.load,
    "solution_set": hbnlp.SolutionSet.load,
    "time_response": hbnlp.TimeResponse.load,
    "flow_history": dns.load_history,
    "flow_state": State.load,
}


def saved(record, path):
    if isinstance(record, dns.History):
        dns.save_history(record, path)
    else:
        (State if isinstance(record, dict) else record).save(path)
    return path


def same(a, b):
    """Whether two records are equal in all that they hold."""
    if dataclasses.is_dataclass(a) and not isinstance(a, type):
        return all(same(getattr(a, part.name), getattr(b, part.name)) for part in dataclasses.fields(a))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind in "fc")
    if isinstance(a, Mapping):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    return a == b


def parts(path):
    """What a file holds, its metadata whole."""
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    return arrays, json.loads(arrays.pop("metadata.json").tobytes())


def rewritten(path, arrays, metadata):
    text = np.frombuffer(json.dumps(metadata).encode(), dtype=np.uint8)
    np.savez(path, **{"metadata.json": text}, **arrays)
    return path.with_suffix(".npz")


@pytest.fixture(params=sorted(LOADERS))
def kind(request):
    return request.param


def test_there_is_an_old_file_of_every_kind_of_record():
    assert FILES.keys() == LOADERS.keys() | {"resolved_branch"}
    assert "format" not in parts(FILES["branch"])[1]


def test_files_of_earlier_versions_load_and_are_the_same_when_saved_anew(kind, tmp_path):
    load = LOADERS[kind]
    old = load(FILES[kind])
    path = saved(old, tmp_path / "new.npz")
    assert same(load(path), old)
    assert parts(path)[1]["format"] == storage.FORMAT


def test_whatever_byte_changes_and_wherever_a_file_is_cut_it_is_one_error_or_the_same(kind, tmp_path):
    load = LOADERS[kind]
    record = load(FILES[kind])
    whole = saved(record, tmp_path / "new.npz").read_bytes()
    rng, path, refused = np.random.default_rng(zlib.crc32(kind.encode())), tmp_path / "damaged.npz", 0
    damaged = [whole[:length] for length in rng.integers(0, len(whole), 60)]
    # the archive's list of its members is a small part of the file, and the most delicate
    tail = max(len(whole) - 1500, 0)
    for place in (*rng.integers(0, len(whole), 200), *rng.integers(tail, len(whole), 200)):
        changed = bytearray(whole)
        changed[place] ^= rng.integers(1, 256)
        damaged.append(bytes(changed))
    for content in damaged:
        path.write_bytes(content)
        try:
            loaded = load(path)
        except LoadError as error:
            assert "damaged.npz" in str(error)  # noqa: PT017 - most of these loads succeed or fail as they may
            refused += 1
        else:
            assert same(loaded, record)
    assert refused > 60


def test_a_column_that_is_missing_misshapen_of_another_kind_or_not_finite_is_refused(kind, tmp_path):
    load, path = LOADERS[kind], tmp_path / "new.npz"
    saved(load(FILES[kind]), path)
    arrays, metadata = parts(path)
    for name, array in arrays.items():
        others = {key: value for key, value in arrays.items() if key != name}
        wrong = {
            "longer": np.concatenate([array, array]) if array.ndim else array[None],
            "deeper": array[..., None],
            "text": np.full(array.shape, "text"),
        }
        if array.size and array.dtype.kind in "fc" and np.isfinite(array).all() and name not in LOOSE.get(kind, ()):
            wrong["nan"] = np.full_like(array, np.nan)
        if kind == "flow_state" and name in {"convection", *(n for n in arrays if n.startswith("wall_"))}:
            wrong = {"text": wrong["text"], "longer": wrong["text"]}  # of another body, which begins anew
        if array.size == 0:
            del wrong["longer"]
        for changed in wrong.values():
            with pytest.raises(ValueError, match=r"bad\.npz|of the state"):
                load(rewritten(tmp_path / "bad.npz", others | {name: changed}, metadata))
        with pytest.raises(LoadError, match=r"bad\.npz"):
            load(rewritten(tmp_path / "bad.npz", others, metadata))
    with pytest.raises(LoadError, match=r"bad\.npz"):
        load(rewritten(tmp_path / "bad.npz", arrays | {"more": np.zeros(2)}, metadata))


LOOSE = {
    "branch": ("multipliers", "stability_error", "special_null"),
    "branch_points": ("special_null", "special_breaks"),
    "branch_to_a_tolerance": ("truncation_error", "special_null"),
    "time_response": ("defects",),
    "sweep": ("coefficients", "amplitudes", "jump_brackets"),
    "time_sweep": ("defects", "jump_brackets"),
}
"""Where nan says that there is nothing."""


MAY_LACK = {"fold_curve": {"periods", "output_names", "event"}}
"""What files of earlier versions do not say."""


def test_plain_values_that_are_missing_or_of_another_kind_are_refused(kind, tmp_path):
    load, path = LOADERS[kind], tmp_path / "new.npz"
    record = load(FILES[kind])
    arrays, metadata = parts(saved(record, path))
    for name in metadata:
        others = {key: value for key, value in metadata.items() if key != name}
        if name not in MAY_LACK.get(kind, set()) | {"format", "arrays", "not_finite"}:
            with pytest.raises(LoadError, match=r"bad\.npz"):
                load(rewritten(tmp_path / "bad.npz", arrays, others))
        for wrong in (None, True, -1, 1.5, [], ["x", 1], {"a": [1]}, [[[]]]):
            try:
                load(rewritten(tmp_path / "bad.npz", arrays, others | {name: wrong}))
            except LoadError as error:
                assert "bad.npz" in str(error)  # noqa: PT017 - some of them are what may be there


WITHOUT_OMEGA = ("branch", "solution", "sweep", "time_sweep", "time_response")


@pytest.mark.parametrize("kind", WITHOUT_OMEGA)
def test_a_record_without_a_frequency_is_refused(kind, tmp_path):
    arrays, metadata = parts(FILES[kind])
    wrong = metadata | {"parameters": {}} | ({"name": "k"} if "name" in metadata else {})
    with pytest.raises(LoadError, match=r"bad\.npz.*its parameters lack"):
        LOADERS[kind](rewritten(tmp_path / "bad.npz", arrays, wrong))


def test_counts_below_zero_are_refused(kind, tmp_path):
    load, path = LOADERS[kind], tmp_path / "new.npz"
    arrays, metadata = parts(saved(load(FILES[kind]), path))
    for name, array in arrays.items():
        if array.dtype.kind == "i" and array.size:
            with pytest.raises(LoadError, match=r"bad\.npz"):
                load(rewritten(tmp_path / "bad.npz", arrays | {name: -1 - array}, metadata))


def test_a_jump_beyond_the_end_of_a_sweep_is_refused(tmp_path):
    arrays, metadata = parts(FILES["sweep"])
    wrong = {"jumps": np.array([10**6]), "jump_brackets": np.array([[0.0, 1.0]])}
    with pytest.raises(LoadError, match=r"bad\.npz.*it has a jump at value 1000000 of"):
        hbnlp.Sweep.load(rewritten(tmp_path / "bad.npz", arrays | wrong, metadata))


def test_a_format_that_there_never_was_is_refused(tmp_path):
    arrays, metadata = parts(FILES["sweep"])
    with pytest.raises(LoadError, match=r"bad\.npz.*is of format -1"):
        hbnlp.Sweep.load(rewritten(tmp_path / "bad.npz", arrays, metadata | {"format": -1}))


def test_a_resolved_branch_of_an_earlier_version_says_what_it_is_and_how_it_is_made_now():
    message = r"resolved_branch\.npz' holds a resolved branch, of an earlier version: .* HarmonicBalance\(.*tolerance="
    with pytest.raises(LoadError, match=message):
        hbnlp.Branch.load(FILES["resolved_branch"])


def test_a_file_of_a_later_format_says_so(tmp_path):
    arrays, metadata = parts(FILES["sweep"])
    with pytest.raises(LoadError, match=r"later\.npz.* is of format 99, this version of hbnlp reads formats up to 1"):
        hbnlp.Sweep.load(rewritten(tmp_path / "later.npz", arrays, metadata | {"format": 99}))


def test_a_file_that_would_fill_the_memory_is_refused_before_it_does(tmp_path, monkeypatch):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**15,)})
    with zipfile.ZipFile(tmp_path / "liar.npz", "w") as archive:
        archive.writestr("a.npy", header.getvalue() + bytes(80))
    with pytest.raises(LoadError, match=r"liar\.npz.*an array \(1000000000000000,\)"):
        load_arrays(tmp_path / "liar.npz", "thing")
    save_arrays(tmp_path / "zeros.npz", "thing", {"a": np.zeros(10**6)}, {})
    load_arrays(tmp_path / "zeros.npz", "thing")
    monkeypatch.setattr(storage, "_ALWAYS", 10**6)
    with pytest.raises(LoadError, match=r"zeros\.npz.*more than 100 times"):
        load_arrays(tmp_path / "zeros.npz", "thing")


def test_what_is_no_file_is_refused_without_waiting_for_it(tmp_path):
    os.mkfifo(tmp_path / "pipe.npz")
    (tmp_path / "folder.npz").mkdir()
    for name, words in (("pipe.npz", "a pipe"), ("folder.npz", "a folder")):
        with pytest.raises(LoadError, match=f"{name}.*that is {words}"):
            hbnlp.Branch.load(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        hbnlp.Branch.load(tmp_path / "none.npz")


def test_an_error_in_loading_is_caught_as_what_it_was_before(tmp_path):
    (tmp_path / "text.npz").write_text("text")
    for kind in (LoadError, ValueError, OSError, hbnlp.HbnlpError):
        with pytest.raises(kind, match=r"text\.npz"):
            hbnlp.Branch.load(tmp_path / "text.npz")
