"""The folder of a table that is being generated: when the manifest is written, what is refused, what is removed."""

from __future__ import annotations

import json
import zlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from spgf_torch.errors import InputError
from spgf_torch.files.digests import sealed_json
from spgf_torch.simulation import run_state as module
from spgf_torch.simulation.run_state import RunState
from spgf_torch.simulation.table import Provenance

MADE_WITH: dict[str, Any] = {"hand_digest": "hand", "sampler": {}, "episode": {"dt": 0.002}, "candidates": 3, "seed": 0}
MUG = Provenance("mug", "digest", **MADE_WITH)


def state(folder: Path, shard: tuple[int, int] = (1, 1), **versions: str) -> RunState:
    return RunState(folder, shard, {**MADE_WITH, "versions": versions or {"physics": "1"}}, types=2)


def test_the_manifest_is_written_every_two_seconds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At 100 s; not 1.9 s later, but 2.1 s later; and the clock begins anew."""
    clock = 100.0
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock))
    its, written = state(tmp_path), []
    its.write_manifest()
    for clock in (101.9, 102.1, 104.0, 104.2):
        its.note(MUG, "open", int(10 * clock))
        written.append(json.loads((tmp_path / "manifest.json").read_text())["trials"])
    assert written == [0, 1021, 1021, 1042]


def test_what_a_killed_call_left_is_removed_by_its_own_kind(tmp_path: Path) -> None:
    """A share of the work removes half-written files of its objects alone, a call on all of them every one."""
    folders = [tmp_path, tmp_path / "shards/mug", tmp_path / "shards/can"]
    for folder in folders:
        folder.mkdir(parents=True, exist_ok=True)
    left = [folder / f".{number:032x}.part" for number, folder in enumerate(folders)]
    for path in left:
        path.write_text("half")
    with state(tmp_path, (1, 2)).open([MUG]):
        assert [path.exists() for path in left] == [True, False, True]
    with state(tmp_path).open([MUG]):
        assert [path.exists() for path in left] == [False, False, False]


@pytest.mark.parametrize("version", ["0", "2"])
def test_another_version_is_refused_by_its_name(tmp_path: Path, version: str) -> None:
    """An older one as well as a newer one, and not the package beside it, which is the same."""
    with state(tmp_path, a="7", physics="1").open([MUG]) as _:
        (tmp_path / "shards/mug").mkdir()
    with (
        pytest.raises(InputError, match=rf"expected trials made with physics {version}, got 1; finish with that"),
        state(tmp_path, a="7", physics=version).open([MUG]),
    ):
        pass


def test_shards_know_their_rows(tmp_path: Path) -> None:
    """Rows 1, 2 and 4 of six are there. A word that is none is as bad as a wrong checksum: tried again."""
    its = state(tmp_path)

    def poses(first: int, count: int) -> int:
        return 100 * first + count

    with its.open([MUG]):
        its.add(MUG, 1, poses(1, 2), ["missed", "success"])
        its.add(MUG, 3, poses(3, 2), [None, "dropped"])
        its.add(MUG, 5, 17, ["slipped"])  # of other poses
        assert its.known(MUG, poses) == [None, "missed", "success", None, "dropped", None]
        assert [path.name for path in sorted((tmp_path / "shards/mug").iterdir())] == [
            "00000001-00000003.json",
            "00000003-00000005.json",
        ]
        content = json.loads((tmp_path / "shards/mug/00000001-00000003.json").read_text())
        content["outcomes"][0] = "lost"
        del content["checksum"]
        checksum = zlib.crc32(json.dumps(content, sort_keys=True).encode())
        (tmp_path / "shards/mug/00000001-00000003.json").write_text(json.dumps({**content, "checksum": checksum}))
        assert its.known(MUG, poses) == [None, None, None, None, "dropped", None]
    assert len(its.incidents) == 2


def test_shards_of_other_settings_are_refused(tmp_path: Path) -> None:
    its = state(tmp_path)
    with its.open([MUG]):
        its.add(MUG, 0, 0, ["missed"])
        other = Provenance("mug", "another", **MADE_WITH)
        with pytest.raises(InputError, match=r"expected trials of these settings and versions, got fingerprint"):
            its.known(other, lambda first, count: 0)
        assert its.known(MUG, lambda first, count: 0)[0] == "missed"


def test_the_trials_of_all_objects_are_counted(tmp_path: Path) -> None:
    """A done object has all six rows, keeps what failed, and has no shards."""
    its = state(tmp_path)
    can = Provenance("can", "another", **MADE_WITH)
    with its.open([MUG, can]):
        its.add(MUG, 0, 0, ["missed"])
        its.note(MUG, "open", 1, failures=["one"])
        its.note(can, "failed", 4, "a reason")
        assert its.trials == 5
        its.done(MUG)
        assert its.trials == 10 and not (tmp_path / "shards/mug").exists()
    told = json.loads((tmp_path / "manifest.json").read_text())
    assert told["trials"] == 10 and told["shard"] == "1/1" and told["objects"] == {
        "can": {"digest": "another", "state": "failed", "trials": 4, "reason": "a reason"},
        "mug": {"digest": "digest", "state": "done", "trials": 6, "failures": ["one"]},
    }  # fmt: skip


@pytest.mark.parametrize(
    "change",
    [
        {"schema": 2},
        {"objects": {"can": {"trials": 2}, "mug": {"trials": -1}}},
        {"objects": {"mug": {}}},
        {"made_with": MADE_WITH},
        {"made_with": {"seed": 0, "versions": {}}},
    ],
)
def test_a_manifest_that_was_not_left_by_this_program(change: dict[str, Any], tmp_path: Path) -> None:
    """Of another schema, with fewer trials than none, without the versions or what trials are made with."""
    its = state(tmp_path)
    content = {"schema": 1, "made_with": its.made_with, "objects": {"mug": {"trials": 0, "state": "open"}}}
    path = tmp_path / "manifest.json"
    path.write_bytes(sealed_json(content, indent=1))
    with its.open([]):
        pass
    path.write_bytes(sealed_json({**content, **change}, indent=1))
    with pytest.raises(InputError, match=r"manifest.json: expected a manifest of simulate of schema 1, got"):
        state(tmp_path).open([]).__enter__()
