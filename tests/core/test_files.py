"""Writing a file: whole or not at all, where its name points, and nothing left of the dead."""

import errno
import os
import socket
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from hbnlp.core.errors import SaveError
from hbnlp.core.files import write_text, written_whole

LEFT = "1234567890abcdef1234567890abcdef.part"


def test_links_are_followed_and_stay(tmp_path):
    (tmp_path / "there").mkdir()
    target, link, chain = tmp_path / "there" / "file", tmp_path / "link", tmp_path / "chain"
    link.symlink_to(target)
    chain.symlink_to("link")
    for text in ("new", "old"):
        write_text(chain, text)
        assert link.is_symlink()
        assert chain.is_symlink()
        assert target.read_text() == text
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["chain", "file", "link", "there"]


def test_a_link_to_itself_is_refused(tmp_path):
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(SaveError, match=r"could not write .*loop.*give the name of a file"):
        write_text(tmp_path / "loop", "")
    assert (tmp_path / "loop").is_symlink()


def test_what_is_no_file_is_refused_and_left_as_it_is(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(os.path.relpath(tmp_path / "socket"))
        for name, words in (("pipe", "a pipe"), ("folder", "a folder"), ("socket", "a socket")):
            before = (tmp_path / name).stat().st_mode
            with pytest.raises(SaveError, match=f"could not write .*{name}.*that is {words}; give the name of a file"):
                write_text(tmp_path / name, "")
            assert (tmp_path / name).stat().st_mode == before
    with pytest.raises(SaveError, match="that is a device"):
        write_text(os.devnull, "")
    assert stat.S_ISCHR(Path(os.devnull).stat().st_mode)


def test_the_permissions_of_a_file_stay(tmp_path):
    path = tmp_path / "file"
    write_text(path, "")
    path.chmod(0o640)
    write_text(path, "new")
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert path.read_text() == "new"


def test_names_as_long_as_there_are_can_be_written(tmp_path):
    path = tmp_path / ("ü" * 127)
    write_text(path, "text")
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_what_a_killed_process_left_is_cleared_but_not_what_belongs_to_the_living_or_to_others(tmp_path):
    path = tmp_path / "file.npz"
    for name in (f"file.npz.{LEFT}", f"file.npz.{LEFT.removesuffix('.part')}.npz.part"):
        (tmp_path / name).write_text("half")
    others = {f"other.npz.{LEFT}", "file.npz.part", "file.npz.mine.part"}
    for name in others:
        (tmp_path / name).write_text("not ours")
    code = (
        "import sys; from hbnlp.core.files import written_whole\n"
        "with written_whole(sys.argv[1]) as handle:\n"
        "    handle.write(b'from another'); handle.flush(); print(flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as living:
        living.stdout.readline()
        write_text(path, "from here")
        parts = {file.name for file in tmp_path.iterdir()} - others - {path.name}
        assert len(parts) == 1
        assert not any(LEFT in name for name in parts)
        living.stdin.close()
        assert living.wait(60) == 0
    assert path.read_text() == "from another"
    assert {file.name for file in tmp_path.iterdir()} == others | {path.name}


def test_what_a_process_killed_in_a_save_left_is_cleared_by_the_next_save(tmp_path):
    path = tmp_path / "file"
    write_text(path, "old")
    code = (
        "import os, signal, sys; from hbnlp.core.files import written_whole\n"
        "with written_whole(sys.argv[1]) as handle:\n"
        "    handle.write(b'half'); handle.flush(); os.kill(os.getpid(), signal.SIGKILL)"
    )
    subprocess.run([sys.executable, "-c", code, str(path)], check=False)
    assert path.read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 2
    write_text(path, "new")
    assert [file.name for file in tmp_path.iterdir()] == ["file"]
    assert path.read_text() == "new"


def test_threads_that_write_the_same_file_at_the_same_time_leave_a_whole_one(tmp_path):
    path, errors = tmp_path / "file", []

    def write(letter):
        try:
            for _ in range(50):
                write_text(path, letter * 5000)
        except OSError as error:
            errors.append(error)

    threads = [threading.Thread(target=write, args=(letter,)) for letter in "abcd"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    assert len(set(path.read_text())) == 1
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


def test_an_error_in_the_block_leaves_the_old_file_and_no_litter(tmp_path):
    path = tmp_path / "file"
    write_text(path, "old")
    for raised, caught in (
        (OSError(errno.ENOSPC, "No space left on device"), SaveError),
        (KeyboardInterrupt(), KeyboardInterrupt),
        (ValueError("odd"), ValueError),
    ):
        with pytest.raises(caught), written_whole(path) as handle:  # noqa: PT012 - half of it is written
            handle.write(b"half")
            raise raised
    assert path.read_text() == "old"
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="limits of a process are POSIX's")
def test_a_disk_that_is_full_is_one_error_of_every_writer_and_the_old_files_stay(tmp_path):
    """The limit on the size of files of a process stands in for the disk's end: writes fail with an OSError, too."""
    code = """
import resource, signal, sys
from pathlib import Path
import hbnlp
from hbnlp import dns
from hbnlp.aero import FrequencyResponse, flat_plate_re100_response, thin_airfoil
from hbnlp.plot import animate
folder = Path(sys.argv[1])
response = flat_plate_re100_response().truncated(2)
flow = dns.Simulation(dns.Grid.around_plate(cells=16, levels=1), dns.SharpPlate(n_modes=2))
history = flow.run(2 * flow.dt)
branch = hbnlp.trace(hbnlp.HarmonicBalance(hbnlp.systems.duffing(), 3), "omega", (0.5, 0.6))
shots = [dns.Snapshot.of(flow)]
writers = {
    "branch": branch.save, "rom": thin_airfoil(2).save, "response": response.save, "table.csv": response.to_csv,
    "state": lambda path: dns.save_state(flow, path), "history": lambda path: dns.save_history(history, path),
    "flow.gif": lambda path: animate(shots, path),
}
for name, write in writers.items():
    if name != "table.csv":
        write(folder / name)
    (folder / name).write_text("old")
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (500, 500))
for name, write in writers.items():
    try:
        write(folder / name)
    except hbnlp.SaveError as error:
        assert name in str(error), error
        print(name)
"""
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=True, capture_output=True, text=True)
    names = {"branch", "rom", "response", "table.csv", "state", "history", "flow.gif"}
    assert set(done.stdout.split()) == names
    assert {file.name for file in tmp_path.iterdir()} == names
    assert {file.read_text() for file in tmp_path.iterdir()} == {"old"}
