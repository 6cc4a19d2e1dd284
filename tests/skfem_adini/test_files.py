"""A file is there whole or not at all: threads, containers, symbolic links, kills, long names."""

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from textwrap import dedent
from unittest.mock import Mock

import pytest

from skfem_adini.ground.files import complete_file, remove_unfinished


def only(folder, name="one"):
    """Whether this file alone lies in a folder."""
    return [path.name for path in folder.iterdir()] == [name]


def write(path, content, **options):
    with complete_file(path, **options) as file:
        for part in (content[: len(content) // 2], content[len(content) // 2 :]):
            file.write(part)


def test_threads_under_one_name(tmp_path):
    """The last one counts; none fails and none writes into another's file."""
    contents = [bytes([k]) * 100_000 for k in range(60)]
    with ThreadPoolExecutor(8) as pool:
        for done in [pool.submit(write, tmp_path / "one", content) for content in contents]:
            done.result()
    assert (tmp_path / "one").read_bytes() in contents
    assert only(tmp_path)


def test_containers_with_one_process_number(tmp_path, monkeypatch):
    """Two processes of the same number, each in its container, on one folder."""
    monkeypatch.setattr(os, "getpid", lambda: 1)
    with complete_file(tmp_path / "one") as first, complete_file(tmp_path / "one") as second:
        first.write(b"first")
        second.write(b"second")
    assert (tmp_path / "one").read_bytes() == b"first"  # left last
    assert only(tmp_path)


def test_exclusive(tmp_path):
    """Of several writers one succeeds, and what it wrote stays."""

    def attempt(k):
        try:
            write(tmp_path / "one", str(k).encode(), exclusive=True)
        except FileExistsError:
            return None
        return k

    with ThreadPoolExecutor(8) as pool:
        (winner,) = [k for k in pool.map(attempt, range(40)) if k is not None]
    assert (tmp_path / "one").read_text() == str(winner)
    assert only(tmp_path)


def test_exclusive_without_hard_links(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "link", Mock(side_effect=OSError(95, "Operation not supported")))
    write(tmp_path / "one", b"first", exclusive=True)
    with pytest.raises(FileExistsError):
        write(tmp_path / "one", b"second", exclusive=True)
    assert (tmp_path / "one").read_bytes() == b"first"
    assert only(tmp_path)


def test_symbolic_links_are_not_followed(tmp_path, monkeypatch):
    """Neither under the temporary name, had someone guessed it, nor under the name itself."""
    victim = tmp_path / "victim"
    victim.write_bytes(b"precious")
    folder = tmp_path / "folder"
    folder.mkdir()
    names = iter(["0" * 32])
    monkeypatch.setattr("skfem_adini.ground.files.token_hex", lambda n: next(names))
    (folder / ("tmp" + "0" * 32)).symlink_to(victim)
    with pytest.raises(FileExistsError):
        write(folder / "one", b"new")
    monkeypatch.undo()
    (folder / "one").symlink_to(victim)
    write(folder / "one", b"new")
    assert victim.read_bytes() == b"precious"
    assert not (folder / "one").is_symlink()


def test_long_names(tmp_path):
    for length in (250, 255):
        write(tmp_path / ("x" * length), b"whole")
        assert (tmp_path / ("x" * length)).read_bytes() == b"whole"
    with pytest.raises(OSError, match="too long"):
        write(tmp_path / ("x" * 256), b"whole")
    assert len(list(tmp_path.iterdir())) == 2


def test_file_and_folder_reach_the_disk_with_the_permissions_of_a_new_file(tmp_path, monkeypatch):
    synced = []
    real = os.fsync
    monkeypatch.setattr(os, "fsync", lambda fd: (synced.append(os.fstat(fd).st_ino), real(fd)))
    write(tmp_path / "one", b"whole")
    assert synced == [(tmp_path / "one").stat().st_ino, tmp_path.stat().st_ino]
    (tmp_path / "plain").write_bytes(b"")
    assert (tmp_path / "one").stat().st_mode == (tmp_path / "plain").stat().st_mode


KILLED = """
    import os, signal, sys
    from pathlib import Path
    from skfem_adini.ground.files import complete_file
    with complete_file(Path(sys.argv[1]) / "killed") as file:
        file.write(b"half")
        file.flush()
        os.kill(os.getpid(), signal.SIGKILL)
"""


def test_remnants_of_a_kill_are_removed(tmp_path):
    """And nothing else: neither what is being written nor files of other names."""
    done = subprocess.run([sys.executable, "-c", dedent(KILLED), str(tmp_path)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert len(list(tmp_path.iterdir())) == 1
    others = [tmp_path / "tmp_data", tmp_path / ("tmp" + "g" * 32), tmp_path / ("atmp" + "0" * 32)]
    for path in others:
        path.write_bytes(b"")
    with complete_file(tmp_path / "one") as file:
        file.write(b"whole")
        remove_unfinished(tmp_path)
    assert (tmp_path / "one").read_bytes() == b"whole"
    assert sorted(tmp_path.iterdir()) == sorted([*others, tmp_path / "one"])


def test_interrupted_before_the_file_is_written(tmp_path, monkeypatch):
    """Ctrl-C when the temporary file has just been made, and nothing was handed out yet."""
    lock = Mock(side_effect=KeyboardInterrupt)
    monkeypatch.setattr("skfem_adini.ground.files.try_lock", lock)
    with pytest.raises(KeyboardInterrupt), complete_file(tmp_path / "one"):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.name != "posix", reason="pipes have names on POSIX systems")
def test_devices_and_pipes_are_not_replaced(tmp_path):
    """A result saved to /dev/null by root took the place of the device."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(OSError, match="no file"), complete_file(pipe) as file:
        file.write(b"1")
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]
