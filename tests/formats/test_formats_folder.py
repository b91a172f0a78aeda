"""A data set is there as a whole or not at all, whatever happens."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from small_trials import refusal

from spgf_torch.errors import InputError
from spgf_torch.files.digests import sealed_json
from spgf_torch.formats import folder
from spgf_torch.formats.card import CARD, checksums
from spgf_torch.formats.folder import check_out, replacing


def contents(path: Path) -> dict[str, str]:
    """File -> text, without cards."""
    files = [file for file in path.rglob("*") if file.is_file() and file.name != CARD]
    return {str(file.relative_to(path)): file.read_text() for file in files}


def exported(out: Path, name: str = "old") -> Path:
    """A folder as an export leaves it, with one file that holds its own name."""
    out.mkdir()
    (out / name).write_text(name)
    (out / CARD).write_bytes(sealed_json({"schema": 1, "files": checksums(out)}))
    return out


def test_a_new_folder(tmp_path: Path) -> None:
    with replacing(tmp_path / "deep/out") as part:
        (part / "sub").mkdir()
        (part / "sub/file").write_text("new")
        assert not (tmp_path / "deep/out").exists()
    assert contents(tmp_path) == {"deep/out/sub/file": "new"}
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["out"]


def test_an_old_folder_is_exchanged_in_one_step(tmp_path: Path) -> None:
    exported(tmp_path / "out")
    with replacing(tmp_path / "out") as part:
        (part / "new").write_text("new")
        assert contents(tmp_path / "out") == {"old": "old"}
    assert contents(tmp_path) == {"out/new": "new"} and len(list(tmp_path.iterdir())) == 1


def test_what_fails_leaves_the_old_one(tmp_path: Path) -> None:
    exported(tmp_path / "out")
    with pytest.raises(KeyboardInterrupt), replacing(tmp_path / "out") as part:
        (part / "new").write_text("half")
        raise KeyboardInterrupt
    assert contents(tmp_path) == {"out/old": "old"} and len(list(tmp_path.iterdir())) == 1


# Of each folder and moment a process of its own, forked: what they import takes seconds.
KILLED = """
import os, pathlib, signal, sys
from spgf_torch.formats import card, folder
from spgf_torch.files.digests import sealed_json
kill = lambda *_: os.kill(os.getpid(), signal.SIGKILL)

def export(out, when):
    if when == "flushing": folder._flush = kill
    if when == "exchanged":
        exchange = folder._exchange
        folder._exchange = lambda *paths: (exchange(*paths), kill())
    with folder.replacing(out) as part:
        (part / "new").write_text("new")
        (part / card.CARD).write_bytes(sealed_json({"schema": 1, "files": card.checksums(part)}))
        if when == "writing": kill()

for when in sys.argv[2:]:
    if (child := os.fork()) == 0:
        export(pathlib.Path(sys.argv[1], when, "out"), when)
        os._exit(0)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
LEFT = {"writing": "old", "flushing": "old", "exchanged": "new"}


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """A folder with an export of each moment at which a new one was killed, and how that ended."""
    folder = tmp_path_factory.mktemp("killed")
    for when in LEFT:
        (folder / when).mkdir()
        exported(folder / when / "out")
    done = subprocess.run([sys.executable, "-c", KILLED, str(folder), *LEFT], capture_output=True, text=True)
    return folder, dict(zip(LEFT, done.stdout.split(), strict=True))


@pytest.mark.parametrize("when", LEFT)
def test_a_killed_export_leaves_the_old_one_or_the_new_one(
    when: str, killed: tuple[Path, dict[str, str]], capfd: pytest.CaptureFixture[str]
) -> None:
    place, ended = killed[0] / when, killed[1]
    assert ended[when] == "-9" and contents(place / "out") == {LEFT[when]: LEFT[when]}
    with replacing(place / "out") as part:
        assert not list(part.iterdir())
        (part / "third").write_text("third")
    assert "removing what an export that was cut off left" in capfd.readouterr().err
    assert contents(place) == {"out/third": "third"} and len(list(place.iterdir())) == 1


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
    exported(tmp_path / "out")
    monkeypatch.setattr(folder, "RENAME_EXCHANGE", 1 << 20)  # a flag that no file system knows
    with pytest.raises(InputError, match="exchange"), replacing(tmp_path / "out") as part:
        (part / "new").write_text("new")
    assert contents(tmp_path) == {"out/old": "old"}


def test_what_may_be_written_to(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    check_out(tmp_path / "out", False, [])
    check_out(tmp_path / "none", False, [])
    (tmp_path / "out").rmdir()
    exported(tmp_path / "out", "file")
    with pytest.raises(InputError, match="overwrite=true"):
        check_out(tmp_path / "out", False, [])
    check_out(tmp_path / "out", True, [tmp_path / "elsewhere"])
    with pytest.raises(InputError, match="in which"):
        check_out(tmp_path / "out", True, [tmp_path / "out/trials"])
    with pytest.raises(InputError, match="a file"):
        check_out(tmp_path / "out/file", True, [])
    with pytest.raises(InputError, match="can be written"), replacing(tmp_path / "out/file/x"):
        pass


@pytest.fixture
def victim(tmp_path: Path) -> Path:
    """A folder that no export may touch, and what is in it."""
    (tmp_path / "victim").mkdir()
    (tmp_path / "victim/precious").write_text("x")
    return tmp_path / "victim"


def test_links_in_the_way_are_left_as_they_are(tmp_path: Path, victim: Path) -> None:
    (tmp_path / "shared").mkdir()
    for name in (".out.part", ".spgf-export-" + "0" * 32):
        (tmp_path / "shared" / name).symlink_to(victim)
    with replacing(tmp_path / "shared/out") as part:
        (part / "new").write_text("new")
    assert contents(victim) == {"precious": "x"} and contents(tmp_path / "shared/out") == {"new": "new"}
    assert len(list((tmp_path / "shared").iterdir())) == 3
    (tmp_path / "link").symlink_to(victim)
    for call in (lambda: check_out(tmp_path / "link", True, []), lambda: replacing(tmp_path / "link").__enter__()):
        with pytest.raises(InputError, match=r"link|export made"):
            call()
    assert contents(victim) == {"precious": "x"}


def marked(left: Path, out: str, kind: str, victim: Path) -> None:
    """A hidden folder that looks as if an export had left it."""
    left.mkdir()
    (left / "mine").write_text("mine")
    own = json.dumps([out, left.stat().st_dev, left.stat().st_ino])
    if kind == "of another folder":
        own = json.dumps([out, left.stat().st_dev, victim.stat().st_ino])
    if kind == "of another place":
        own = own.replace(out, "other")
    (victim / "marker").write_text(own)
    if kind == "a link":
        (left / folder.MARKER).symlink_to(victim / "marker")
    elif kind == "a hard link":
        (left / folder.MARKER).hardlink_to(victim / "marker")
    elif kind == "a folder":
        (left / folder.MARKER).mkdir()
    elif kind == "a pipe":
        os.mkfifo(left / folder.MARKER)
    elif kind != "none":
        (left / folder.MARKER).write_text(own if kind.startswith("of") else kind)


@pytest.mark.parametrize(
    "kind",
    ["none", "of another folder", "of another place", "a link", "a hard link", "a folder", "a pipe", "[", "null"],
)
def test_what_only_looks_left_over_stays(kind: str, tmp_path: Path, victim: Path) -> None:
    left = tmp_path / (".spgf-export-" + "a" * 32)
    marked(left, "out", kind, victim)
    with replacing(tmp_path / "out") as part:
        (part / "new").write_text("new")
    assert (left / "mine").read_text() == "mine" and (victim / "precious").read_text() == "x"


@pytest.mark.parametrize("other", ["file", "link", "link to a folder", "in a folder", "pipe"])
def test_a_folder_with_more_than_an_export_made_stays(other: str, tmp_path: Path, victim: Path) -> None:
    out = exported(tmp_path / "out")
    if other == "in a folder":
        (out / "notes").mkdir()
        (out / "notes/mine").write_text("mine")
    elif other == "file":
        (out / "mine").write_text("mine")
    elif other == "pipe":
        os.mkfifo(out / "pipe")
    else:
        (out / "link").symlink_to(victim / "precious" if other == "link" else victim)
    before = sorted(tmp_path.rglob("*"))
    for call in (lambda: check_out(out, True, []), lambda: replacing(out).__enter__()):
        with pytest.raises(InputError, match="move it elsewhere"):
            call()
    assert sorted(tmp_path.rglob("*")) == before


def test_what_is_put_there_meanwhile_stays(tmp_path: Path) -> None:
    for first in (True, False):
        out = tmp_path / f"out{first}"
        if first:
            exported(out)
        with pytest.raises(InputError, match="can be written"), replacing(out) as part:
            (part / "new").write_text("new")
            if first:
                out.rename(tmp_path / "away")
            out.mkdir()
            (out / "mine").write_text("mine")
        assert contents(out) == {"mine": "mine"}
    assert contents(tmp_path / "away") == {"old": "old"}
