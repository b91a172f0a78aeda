"""A data set is there as a whole or not at all, whatever happens."""

import subprocess
import sys
from pathlib import Path

import pytest
from small_trials import refusal

from spgf_torch.config import InputError
from spgf_torch.datasets import folder
from spgf_torch.datasets.folder import check_out, replacing


def contents(path: Path) -> dict[str, str]:
    return {str(file.relative_to(path)): file.read_text() for file in path.rglob("*") if file.is_file()}


def test_a_new_folder(tmp_path: Path) -> None:
    with replacing(tmp_path / "deep/out") as part:
        (part / "sub").mkdir()
        (part / "sub/file").write_text("new")
        assert not (tmp_path / "deep/out").exists()
    assert contents(tmp_path) == {"deep/out/sub/file": "new"}
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["out"]


def test_an_old_folder_is_exchanged_in_one_step(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out/old").write_text("old")
    with replacing(tmp_path / "out") as part:
        (part / "new").write_text("new")
        assert contents(tmp_path / "out") == {"old": "old"}
    assert contents(tmp_path) == {"out/new": "new"} and len(list(tmp_path.iterdir())) == 1


def test_what_fails_leaves_the_old_one(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out/old").write_text("old")
    with pytest.raises(KeyboardInterrupt), replacing(tmp_path / "out") as part:
        (part / "new").write_text("half")
        raise KeyboardInterrupt
    assert contents(tmp_path) == {"out/old": "old"} and len(list(tmp_path.iterdir())) == 1


KILLED = """
import os, pathlib, signal, sys
from spgf_torch.datasets import folder
out, when = pathlib.Path(sys.argv[1]), sys.argv[2]
kill = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
if when == "flushing": folder._flush = kill
if when == "exchanged":
    exchange = folder._exchange
    folder._exchange = lambda part, out: (exchange(part, out), kill())
with folder.replacing(out) as part:
    (part / "new").write_text("new")
    if when == "writing": kill()
"""


@pytest.mark.parametrize(("when", "left"), [("writing", "old"), ("flushing", "old"), ("exchanged", "new")])
def test_a_killed_export_leaves_the_old_one_or_the_new_one(
    when: str, left: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "old").write_text("old")
    done = subprocess.run([sys.executable, "-c", KILLED, str(out), when])
    assert done.returncode == -9 and contents(out) == {left: left}
    capfd.readouterr()
    with replacing(out) as part:
        assert not list(part.iterdir())
        (part / "third").write_text("third")
    assert "removing what an export that was cut off left" in capfd.readouterr().err
    assert contents(tmp_path) == {"out/third": "third"} and len(list(tmp_path.iterdir())) == 1


def test_two_at_once_are_refused(tmp_path: Path) -> None:
    with replacing(tmp_path / "out") as part:
        (part / "mine").write_text("mine")
        with pytest.raises(InputError, match="no other export"), replacing(tmp_path / "out"):
            pass
        assert (part / "mine").exists()
    assert contents(tmp_path / "out") == {"mine": "mine"}


def test_a_full_disk_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error, replacing(tmp_path / "out"):
        raise OSError(28, "No space left on device")
    assert "No space left" in refusal(error.value) and not list(tmp_path.iterdir())


def test_a_file_system_that_cannot_exchange(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Then nothing is replaced: two renames would leave a moment without either."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out/old").write_text("old")
    monkeypatch.setattr(folder, "RENAME_EXCHANGE", 1 << 20)  # a flag that no file system knows
    with pytest.raises(InputError, match="exchange"), replacing(tmp_path / "out") as part:
        (part / "new").write_text("new")
    assert contents(tmp_path) == {"out/old": "old"}


def test_what_may_be_written_to(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    check_out(tmp_path / "out", False, [])
    check_out(tmp_path / "none", False, [])
    (tmp_path / "out/file").write_text("")
    with pytest.raises(InputError, match="overwrite=true"):
        check_out(tmp_path / "out", False, [])
    check_out(tmp_path / "out", True, [tmp_path / "elsewhere"])
    with pytest.raises(InputError, match="in which"):
        check_out(tmp_path / "out", True, [tmp_path / "out/trials"])
    with pytest.raises(InputError, match="a file"):
        check_out(tmp_path / "out/file", True, [])
    with pytest.raises(InputError, match="can be written"), replacing(tmp_path / "out/file/x"):
        pass
