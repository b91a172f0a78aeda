"""What is done of a trial table, on disk: a call that was killed at any moment loses only what it was about to write.

In the folder of the table: `shards/OBJECT/FIRST-END.json`, the outcomes of a chunk of an object's candidates, until
all are there and the table is written; `manifest.json`, what is done, what failed and why, made with which settings.
Every file is written under a temporary name, flushed to disk and renamed, and so is its folder's entry: it is there as
a whole or not at all. Shards are the truth and say what they were made from; the manifest never says more than they.
"""

from __future__ import annotations

import fcntl
import json
import shutil
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from spgf_torch.cache import fingerprint
from spgf_torch.errors import InputError
from spgf_torch.files.reading import json_values
from spgf_torch.files.sealing import sealed_json
from spgf_torch.files.writing import parts_in, sync, write_bytes
from spgf_torch.hands.config import GRASP_TYPES
from spgf_torch.simulation.table import OUTCOMES, Origin, compare

SCHEMA = 1
SHARDS = "shards"
EVERY = 2.0  # s between two manifests at least: a run of thousands of objects has a large one


class Journal:
    """The folder of a trial table that is being made; `open` it.

    Args:
        folder: the table's, made if need be.
        shard: (i, n), 1 <= i <= n: the share of the objects that is this call's, where others work on the rest.
        made_with: what is the same for all objects: the fields of an `Origin` but the object's, and `versions`.

    Attributes:
        objects: name -> how it stands (`note`).
        incidents: what went wrong in this call and was made good, or led to a failure among `objects`.
        left_out: what was not even begun, and why.
    """

    def __init__(self, folder: Path, shard: tuple[int, int], made_with: Mapping[str, Any]) -> None:
        self.folder, self.shard, self.made_with = folder, shard, dict(made_with)
        part = "" if shard == (1, 1) else f".{shard[0]}-of-{shard[1]}"
        self.path = folder / f"manifest{part}.json"
        self.objects: dict[str, dict[str, Any]] = {}
        self.incidents: list[str] = []
        self.left_out: list[str] = []
        self._told = 0.0

    @contextmanager
    def open(self, origins: Sequence[Origin]) -> Iterator[None]:
        """Nobody else writes here meanwhile (but other shards of the same n); the manifest is up to date afterwards.

        Raises InputError for a folder that cannot be made or is in use, and for what was begun with other settings.
        """
        try:
            (self.folder / SHARDS).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            got = f"{self.folder} ({error.strerror})"
            raise InputError(f"out: expected a folder that can be made and written to, got {got}") from None
        with self._locked():
            try:
                self._begin(origins)
                try:
                    yield
                finally:
                    with suppress(OSError):  # on a full disk the one before stays; it says less, nothing false
                        self.write_manifest()
            finally:
                self._tidy()

    def known(self, origin: Origin, poses: Callable[[int, int], int]) -> list[str | None]:
        """What shards say of an object: of each row its outcome, None where it has none yet.

        `poses(first, count)` is the checksum of the poses of these rows. A shard of other ones, or a damaged one, is
        an incident and left out; one of other settings is refused.
        """
        known: list[str | None] = [None] * rows_of(origin)
        for path in sorted(self._shards(origin.object_name).glob("*.json")):
            content = _read_shard(path)
            if content is not None and content["origin"] != self._fingerprint(origin):
                raise InputError(f"{path}: expected trials made with these settings and versions, got others")
            if content is None or content["poses"] != poses(content["first"], len(content["outcomes"])):
                self.incidents.append(f"{path} is damaged or of other poses; its candidates were tried again")
                path.unlink()
                continue
            for row, outcome in enumerate(content["outcomes"], content["first"]):
                known[row] = outcome or known[row]
        return known

    def add(self, origin: Origin, first: int, poses: int, outcomes: Sequence[str | None]) -> None:
        """Keep the outcomes of the rows from `first` on; `poses` is the checksum of theirs."""
        content = {
            "origin": self._fingerprint(origin),
            "first": first,
            "poses": poses,
            "outcomes": list(outcomes),
        }
        folder = self._shards(origin.object_name)
        if not folder.is_dir():
            folder.mkdir(parents=True, exist_ok=True)
            sync(folder.parent)
        path = folder / f"{first:08d}-{first + len(outcomes):08d}.json"
        write_bytes(path, json.dumps({**content, "checksum": _checksum(content)}).encode())

    def note(self, origin: Origin, state: str, trials: int, reason: str = "", failures: Sequence[Any] = ()) -> None:
        """Where an object stands: `open`, `done` or `failed`, how many trials have an outcome, and what went wrong."""
        entry: dict[str, Any] = {"digest": origin.object_digest, "state": state, "trials": trials}
        if reason:
            entry["reason"] = reason
        if failures:
            entry["failures"] = list(failures)
        self.objects[origin.object_name] = entry
        if time.monotonic() - self._told > EVERY:
            self.write_manifest()

    def done(self, origin: Origin) -> None:
        """The object's table is written: its shards have served."""
        sync(self.folder)
        shutil.rmtree(self._shards(origin.object_name), ignore_errors=True)
        failures = self.objects.get(origin.object_name, {}).get("failures", [])
        self.note(origin, "done", rows_of(origin), failures=failures)

    @property
    def trials(self) -> int:
        """How many have an outcome."""
        return sum(entry["trials"] for entry in self.objects.values())

    def write_manifest(self) -> None:
        self._told = time.monotonic()
        content = {
            "schema": SCHEMA,
            "shard": "{}/{}".format(*self.shard),
            "made_with": self.made_with,
            "trials": self.trials,
            "left_out": self.left_out,
            "incidents": self.incidents,
            "objects": dict(sorted(self.objects.items())),
        }
        write_bytes(self.path, sealed_json(content, indent=1))

    def _begin(self, origins: Sequence[Origin]) -> None:
        before = self._read_manifest()
        begun = [origin for origin in origins if self._shards(origin.object_name).is_dir()]
        if before:
            made = before["made_with"]
            common = {key: made[key] for key in made if key != "versions"}
            for origin in begun or origins[:1]:
                digest = before["objects"].get(origin.object_name, {}).get("digest", origin.object_digest)
                compare(self.path, origin, Origin(origin.object_name, digest, **common))
            if begun and made["versions"] != self.made_with["versions"]:
                name = next(n for n, v in self.made_with["versions"].items() if v != made["versions"].get(n))
                got = f"{made['versions'].get(name)}; finish with that, or remove {self.folder / SHARDS}"
                raise InputError(
                    f"{self.path}: expected trials made with {name} {self.made_with['versions'][name]}, got {got}"
                )
            self.objects = before["objects"]
        own = {o.object_name for o in origins}
        for folder in (self.folder, *(entry for entry in (self.folder / SHARDS).iterdir() if entry.is_dir())):
            if self.shard == (1, 1) or folder.name in own:
                for left in parts_in(folder):
                    left.unlink(missing_ok=True)

    def _read_manifest(self) -> dict[str, Any]:
        if not self.path.is_file():
            return {}
        try:
            content = json_values(self.path, "a manifest of simulate", sealed=True)
            Origin("", "", **{key: value for key, value in content["made_with"].items() if key != "versions"})
            if content["schema"] != SCHEMA or not all(entry["trials"] >= 0 for entry in content["objects"].values()):
                raise ValueError(f"schema {content['schema']}")
            content["made_with"]["versions"].items()
        except InputError:
            raise
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            got = f"something else ({type(error).__name__})"
            raise InputError(f"{self.path}: expected a manifest of simulate of schema {SCHEMA}, got {got}") from None
        return content

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """A whole call keeps all others out, a shard only the whole and its own like; the kernel lets go at death."""
        lock = self.folder / SHARDS / f".lock{self.path.stem.removeprefix('manifest')}"
        general = self.folder / SHARDS / ".lock"
        with general.open("a") as shared, lock.open("a") as own:
            try:
                fcntl.flock(shared, fcntl.LOCK_NB | (fcntl.LOCK_EX if lock == general else fcntl.LOCK_SH))
                if lock != general:
                    fcntl.flock(own, fcntl.LOCK_NB | fcntl.LOCK_EX)
            except BlockingIOError:
                raise InputError(
                    f"out: expected a folder that no other simulate writes to, got {self.folder}"
                ) from None
            except OSError:
                pass  # a file system without locks: results are the same, two calls would only do the work twice
            yield

    def _tidy(self) -> None:
        """Remove what nobody needs any more: the folder of shards once it is empty, manifests of shares once whole."""
        if self.shard != (1, 1):
            return
        if all(entry["state"] == "done" for entry in self.objects.values()):
            for path in self.folder.glob("manifest.*-of-*.json"):
                path.unlink(missing_ok=True)
            for path in (self.folder / SHARDS).glob(".lock*"):
                path.unlink(missing_ok=True)
            with suppress(OSError):  # shards of objects that are not of this call
                (self.folder / SHARDS).rmdir()

    def _shards(self, object_name: str) -> Path:
        return self.folder / SHARDS / object_name

    def _fingerprint(self, origin: Origin) -> str:
        return fingerprint(asdict(origin), self.made_with["versions"])


def rows_of(origin: Origin) -> int:
    """How many rows the table of an object has."""
    return origin.candidates * len(GRASP_TYPES)


def _read_shard(path: Path) -> dict[str, Any] | None:
    """The content of a shard, or None where it is not what was written."""
    try:
        content = json.loads(path.read_bytes())
        checksum = content.pop("checksum")
        whole = checksum == _checksum(content) and all(word is None or word in OUTCOMES for word in content["outcomes"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return content if whole else None


def _checksum(content: Mapping[str, Any]) -> int:
    return zlib.crc32(json.dumps(content, sort_keys=True).encode())
