"""Files that are there as a whole or not at all."""

import errno
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from spgf_torch.files.writing import parts_in, write_bytes, write_text


def test_a_file_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "file"
    write_text(path, "old")
    write_bytes(path, b"new")
    assert path.read_text() == "new" and list(tmp_path.iterdir()) == [path]
    mask = os.umask(0)
    os.umask(mask)
    assert path.stat().st_mode & 0o777 == 0o666 & ~mask


@pytest.mark.parametrize("call", ["open", "fsync", "replace"])
def test_what_fails_leaves_the_old_file_alone(call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    path = tmp_path / "file"
    write_text(path, "old")
    monkeypatch.setattr("pathlib.Path.replace" if call == "replace" else f"os.{call}", full)
    with pytest.raises(OSError, match="No space left") as error:
        write_text(path, "new")
    assert error.value.filename == str(path) and error.value.errno == errno.ENOSPC
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


LIMITED = """
import resource, signal, sys
from pathlib import Path
from spgf_torch.files.writing import write_bytes
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
write_bytes(Path(sys.argv[1]), bytes(100_000))
"""


def test_a_file_that_does_not_fit_leaves_nothing(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", LIMITED, str(tmp_path / "file")], capture_output=True, text=True)
    assert done.returncode == 1 and "File too large" in done.stderr and not list(tmp_path.iterdir())


def linked(path: Path, victim: Path) -> None:
    path.symlink_to(victim)


def hard_linked(path: Path, victim: Path) -> None:
    path.hardlink_to(victim)


@pytest.mark.parametrize("plant", [linked, hard_linked])
def test_a_link_is_replaced_and_what_it_names_stays(plant: Callable[[Path, Path], None], tmp_path: Path) -> None:
    (tmp_path / "victim").write_text("precious")
    plant(tmp_path / "file", tmp_path / "victim")
    write_text(tmp_path / "file", "new")
    assert (tmp_path / "victim").read_text() == "precious" and (tmp_path / "file").read_text() == "new"


def test_names_as_long_as_they_may_be(tmp_path: Path) -> None:
    write_text(tmp_path / ("ä" * 127), "new")
    assert not list(parts_in(tmp_path))


def test_parts_are_told_from_what_others_made(tmp_path: Path) -> None:
    (tmp_path / ("." + "a" * 32 + ".part")).write_text("half")
    for name in ("file.part", ".file.part", "." + "a" * 31 + ".part"):
        (tmp_path / name).write_text("somebody's")
    (tmp_path / ("." + "b" * 32 + ".part")).symlink_to(tmp_path / "file.part")
    (tmp_path / ("." + "c" * 32 + ".part")).mkdir()
    assert [path.name for path in parts_in(tmp_path)] == ["." + "a" * 32 + ".part"]
