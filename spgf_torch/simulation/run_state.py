"""The state of a generation on disk: a call that is killed at any moment loses only what it was about to write.

In the folder of the table: `shards/OBJECT/FIRST-END.json`, the outcomes of a chunk of an object's candidates, until
all are there and the table is written; `manifest.json`, what is done, what failed and why, made with which settings.
Every file is written atomically: under a temporary name, flushed to disk and renamed, and so is its folder's entry.
Shards are authoritative and say what they were made from; the manifest never says more than they.
"""

from __future__ import annotations

import fcntl
import json
import shutil
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from spgf_torch.cache import fingerprint
from spgf_torch.errors import InputError
from spgf_torch.files.digests import sealed_json
from spgf_torch.files.reading import json_values
from spgf_torch.files.writing import parts_in, sync, write_bytes
from spgf_torch.simulation.label import outcome_of
from spgf_torch.simulation.table import OUTCOMES, Provenance, compare

SCHEMA = 1
SHARDS = "shards"
EVERY = 2.0  # s between two manifests at least: a run of thousands of objects has a large one


class RunState:
    """The folder of a trial table that is being generated; use it within `open`.

    Args:
        folder: of the table, made if it is missing.
        shard: (i, n), 1 <= i <= n: the share of the objects that is this call's, where others work on the rest.
        made_with: what is the same for all objects: the fields of an `Provenance` but the object's, and `versions`.
        types: how many grasp types the hand has.

    Attributes:
        objects: name -> state (`note`).
        incidents: failures of this call that were repaired, or are among `objects`.
        left_out: objects that were not begun, and why.
    """

    def __init__(self, folder: Path, shard: tuple[int, int], made_with: Mapping[str, Any], types: int) -> None:
        self.folder, self.shard, self.made_with, self.types = folder, shard, dict(made_with), types
        part = "" if shard == (1, 1) else f".{shard[0]}-of-{shard[1]}"
        self.path = folder / f"manifest{part}.json"
        self.objects: dict[str, dict[str, Any]] = {}
        self.incidents: list[str] = []
        self.left_out: list[str] = []
        self._written_at = 0.0

    @contextmanager
    def open(self, provenances: Sequence[Provenance]) -> Iterator[None]:
        """Lock the folder against other calls (but shards of the same n); bring the manifest up to date at the end.

        Raises InputError for a folder that cannot be made or is in use, and for what was begun with other settings.
        """
        try:
            (self.folder / SHARDS).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            got = f"{self.folder} ({error.strerror})"
            raise InputError(f"out: expected a folder that can be made and written to, got {got}") from None
        with self._locked():
            try:
                self._begin(provenances)
                try:
                    yield
                finally:
                    with suppress(OSError):  # on a full disk the last one stays: incomplete, but not false
                        self.write_manifest()
            finally:
                self._tidy()

    def known(
        self, provenance: Provenance, poses: Callable[[int, int], int], rows: int | None = None
    ) -> list[str | None]:
        """Read the shards of an object: the outcome of each of its `rows`, None where there is none yet.

        `poses(first, count)` is the checksum of the poses of these rows. A shard of other poses, or a damaged one,
        is an incident and left out; one of other settings is refused.
        """
        known: list[str | None] = [None] * (self.rows(provenance) if rows is None else rows)
        for path in sorted(self._shards(provenance.object_name).glob("*.json")):
            content = _read_shard(path)
            if content is not None and content["origin"] != self._fingerprint(provenance):
                raise InputError(
                    f"{path}: expected trials of these settings and versions, got fingerprint {content['origin']!s:.16}"
                )
            if content is None or content["poses"] != poses(content["first"], len(content["outcomes"])):
                self.incidents.append(f"{path} is damaged or of other poses; its candidates were tried again")
                path.unlink()
                continue
            for row, outcome in enumerate(content["outcomes"], content["first"]):
                known[row] = outcome or known[row]
        return known

    def add(self, provenance: Provenance, first: int, poses: int, outcomes: Sequence[str | None]) -> None:
        """Write the outcomes of the rows from `first` on; `poses` is the checksum of their poses."""
        content = {
            "origin": self._fingerprint(provenance),
            "first": first,
            "poses": poses,
            "outcomes": list(outcomes),
        }
        folder = self._shards(provenance.object_name)
        if not folder.is_dir():
            folder.mkdir(parents=True, exist_ok=True)
            sync(folder.parent)
        path = folder / f"{first:08d}-{first + len(outcomes):08d}.json"
        write_bytes(path, json.dumps({**content, "checksum": _checksum(content)}).encode())

    def note(
        self, provenance: Provenance, state: str, trials: int, reason: str = "", failures: Sequence[Any] = ()
    ) -> None:
        """Note the state of an object: `open`, `done` or `failed`, trials with an outcome, and failures."""
        entry: dict[str, Any] = {"digest": provenance.object_digest, "state": state, "trials": trials}
        if reason:
            entry["reason"] = reason
        if failures:
            entry["failures"] = list(failures)
        self.objects[provenance.object_name] = entry
        if time.monotonic() - self._written_at > EVERY:
            self.write_manifest()

    def done(self, provenance: Provenance, allotted: Mapping[str, Any] | None = None) -> None:
        """Remove the shards of an object whose table is written; `allotted`: what a budget gave it (`allotment`)."""
        sync(self.folder)
        shutil.rmtree(self._shards(provenance.object_name), ignore_errors=True)
        failures = self.objects.get(provenance.object_name, {}).get("failures", [])
        rows = allotted["candidates"] * self.types if allotted else self.rows(provenance)
        self.note(provenance, "done", rows, failures=failures)
        if allotted:
            self.objects[provenance.object_name]["allotted"] = dict(allotted)

    def rows(self, provenance: Provenance) -> int:
        """Return the number of rows in the table of an object; with a budget, the most that there may be."""
        return provenance.candidates * self.types

    @property
    def trials(self) -> int:
        """The number of trials that have an outcome."""
        return sum(entry["trials"] for entry in self.objects.values())

    def write_manifest(self) -> None:
        self._written_at = time.monotonic()
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

    def _begin(self, provenances: Sequence[Provenance]) -> None:
        before = self._read_manifest()
        begun = [provenance for provenance in provenances if self._shards(provenance.object_name).is_dir()]
        if before:
            made = before["made_with"]
            common = {key: made[key] for key in made if key != "versions"}
            for provenance in begun or provenances[:1]:
                digest = before["objects"].get(provenance.object_name, {}).get("digest", provenance.object_digest)
                compare(self.path, provenance, Provenance(provenance.object_name, digest, **common))
            if begun and made["versions"] != self.made_with["versions"]:
                name = next(n for n, v in self.made_with["versions"].items() if v != made["versions"].get(n))
                got = f"{made['versions'].get(name)}; finish with that, or remove {self.folder / SHARDS}"
                raise InputError(
                    f"{self.path}: expected trials made with {name} {self.made_with['versions'][name]}, got {got}"
                )
            self.objects = before["objects"]
        own = {o.object_name for o in provenances}
        for folder in (self.folder, *(entry for entry in (self.folder / SHARDS).iterdir() if entry.is_dir())):
            if self.shard == (1, 1) or folder.name in own:
                for left in parts_in(folder):
                    left.unlink(missing_ok=True)

    def _read_manifest(self) -> dict[str, Any]:
        if not self.path.is_file():
            return {}
        try:
            content = json_values(self.path, "a manifest of simulate", sealed=True)
            Provenance("", "", **{key: value for key, value in content["made_with"].items() if key != "versions"})
            if content["schema"] != SCHEMA or not all(entry["trials"] >= 0 for entry in content["objects"].values()):
                raise ValueError(f"schema {content['schema']}")
            content["made_with"]["versions"].items()
        except InputError:
            raise
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            got = f"a file that is none ({type(error).__name__}: {error!s:.40})"
            raise InputError(f"{self.path}: expected a manifest of simulate of schema {SCHEMA}, got {got}") from None
        return content

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Lock out all other calls, or as a shard the whole call and the same shard; the kernel unlocks at death."""
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
                pass  # no locks on this file system: two calls would do the work twice, with the same results
            yield

    def _tidy(self) -> None:
        """Remove obsolete files: the folder of shards once it is empty, manifests of shares once all are done."""
        if self.shard != (1, 1):
            return
        if all(entry.get("state") == "done" for entry in self.objects.values()):
            for path in self.folder.glob("manifest.*-of-*.json"):
                path.unlink(missing_ok=True)
            for path in (self.folder / SHARDS).glob(".lock*"):
                path.unlink(missing_ok=True)
            with suppress(OSError):  # shards of objects that are not of this call
                (self.folder / SHARDS).rmdir()

    def _shards(self, object_name: str) -> Path:
        return self.folder / SHARDS / object_name

    def _fingerprint(self, provenance: Provenance) -> str:
        return fingerprint(provenance.plain, self.made_with["versions"])


def _read_shard(path: Path) -> dict[str, Any] | None:
    """Return the content of a shard, or None where it is not what was written."""
    try:
        content = json.loads(path.read_bytes())
        checksum = content.pop("checksum")
        whole = checksum == _checksum(content) and all(
            word is None or outcome_of(word) in OUTCOMES for word in content["outcomes"]
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return content if whole else None


def _checksum(content: Mapping[str, Any]) -> int:
    return zlib.crc32(json.dumps(content, sort_keys=True).encode())
