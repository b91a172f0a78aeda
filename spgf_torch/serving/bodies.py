"""What a request sends, taken into files of its own: bounded in size and time, under names that we give.

Nothing that a request says is a path: of a file's name the suffix alone counts, and only one that a reader knows.
"""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from starlette.formparsers import MultiPartException
from starlette.requests import Request

from spgf_torch.errors import InputError
from spgf_torch.scene.config import SceneConfig
from spgf_torch.serving.config import ServeConfig

Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]

# Keys of conf/scene that name files: in a request they are parts of multipart/form-data.
FILES = ("input", "intrinsics", "poses", "mask", "segments")
# What a request may say besides the settings of a scene, and other words for these.
OWN = ("top", "types")
ALIASES = {"viewpoint": "viewpoints", "as": "read_as", "K": "intrinsics", "type": "types"}
SETTINGS = tuple(sorted({*SceneConfig.__dataclass_fields__, *OWN} - set(FILES) | {"intrinsics"}))
# Where the suffix of a file is not told by its name: by the content's type, or else by its first bytes.
TYPES = {
    "application/json": ".json",
    "model/ply": ".ply",
    "application/x-ply": ".ply",
    "application/x-pcd": ".pcd",
    "application/x-npy": ".npy",
    "application/x-npz": ".npz",
    "text/plain": ".xyz",
    "text/csv": ".csv",
    "image/png": ".png",
    "image/tiff": ".tiff",
    "model/obj": ".obj",
    "model/stl": ".stl",
    "model/gltf-binary": ".glb",
}
_MAGIC = {
    b"ply": ".ply",
    b"# .PCD": ".pcd",
    b"VERSION": ".pcd",
    b"\x93NUMPY": ".npy",
    b"PK\3\4": ".npz",
    b"\x89PNG": ".png",
    b"II*\0": ".tiff",
    b"MM\0*": ".tiff",
    b"glTF": ".glb",
}
SUFFIXES = frozenset(
    (
        *TYPES.values(),
        ".txt",
        ".xyzn",
        ".xyzrgb",
        ".tsv",
        ".pts",
        ".asc",
        ".tif",
        ".pgm",
        ".pfm",
        ".off",
        ".yaml",
        ".yml",
        ".mat",
    )
)
# What programs name a body of any kind, curl above all.
_ANY = frozenset(("", "application/octet-stream", "application/x-www-form-urlencoded"))
MULTIPART = "multipart/form-data"
# Of a form: files, settings, and bytes of a setting.
MOST_FILES, MOST_FIELDS, LONGEST_FIELD = 64, 100, 1 << 16
LONGEST_NAME = 80  # characters of a file's name that are repeated
# So much more than is taken is still read, and dropped: who has not sent all does not read what is wrong.
DRAINED = 4


@dataclass(frozen=True)
class Job:
    """What a prediction is asked for.

    Attributes:
        folder: of the files, which goes with the request. files: key of conf/scene -> names in it, in order.
        settings: as they were sent, not checked. arrays: whether the input is a JSON object that holds all.
        called: name in the folder -> what whoever asks knows it by: its file's name, its part's, or `body`.
    """

    folder: str
    files: dict[str, list[str]] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    arrays: bool = False
    called: dict[str, str] = field(default_factory=dict)


async def job_of(request: Request, folder: Path, config: ServeConfig) -> Job:
    """Take the body of a request into `folder`.

    Raises InputError for what cannot be used, HTTPException for what is too large (413), too slow (408) or of an
    unknown kind (415), and starlette's ClientDisconnect where the connection is cut.
    """
    most = round(config.largest_mb * 1e6)
    request = Request(request.scope, bounded(request.receive, most, config.body_seconds))
    settings = settings_of(request.query_params.multi_items())
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind == MULTIPART:
        return await _of_form(request, folder, settings)
    path = folder / "body"
    with path.open("wb") as stream:
        async for chunk in request.stream():
            stream.write(chunk)
    suffix = suffix_of(kind, None, path)
    name = f"input{suffix}"
    path.rename(folder / name)
    return Job(str(folder), {"input": [name]}, settings, suffix == ".json", {name: "body"})


async def _of_form(request: Request, folder: Path, settings: dict[str, Any]) -> Job:
    job = Job(str(folder), {}, settings)
    try:
        form = await request.form(max_files=MOST_FILES, max_fields=MOST_FIELDS, max_part_size=LONGEST_FIELD)
    except HTTPException as error:
        if error.status_code != 400:
            raise
        raise InputError(f"body: expected {MULTIPART}, got {error.detail}") from None
    except MultiPartException as error:
        raise InputError(f"body: expected {MULTIPART}, got {error.message}") from None
    try:
        words: list[tuple[str, str]] = []
        for key, value in form.multi_items():
            if isinstance(value, UploadFile):
                await _take(value, ALIASES.get(key, key), job)
            else:
                words.append((key, value))
    finally:
        await form.close()
    given = settings_of(words)
    if twice := sorted(given.keys() & settings.keys()):
        raise InputError(f"{twice[0]}: expected one value, got one in the address and one in the form")
    return replace(job, settings={**settings, **given})


async def _take(upload: UploadFile, key: str, job: Job) -> None:
    """A part of a form, as a file named by its key."""
    if key not in FILES:
        raise InputError(f"{key[:40]}: expected a file as one of {', '.join(FILES)}; got one of this name")
    names, folder = job.files.setdefault(key, []), Path(job.folder)
    path = folder / "part"
    with path.open("wb") as stream:
        while chunk := await upload.read(1 << 20):
            stream.write(chunk)
    if not path.stat().st_size:
        raise InputError(f"{key}: expected a file with something in it, got {called(upload.filename, 'one')}, empty")
    suffix = suffix_of((upload.content_type or "").partition(";")[0].strip().lower(), upload.filename, path)
    names.append(f"{key}{f'_{len(names) + 1}' if names else ''}{suffix}")
    path.rename(folder / names[-1])
    job.called[names[-1]] = called(upload.filename, key)


def called(filename: str | None, key: str) -> str:
    """What a part is called in words: by its file's name, without folders and what does not print, else by its key."""
    bare = re.split(r"[/\\]", filename or "")[-1]
    return "".join(c for c in bare if c.isprintable()).strip()[:LONGEST_NAME] or key


def suffix_of(kind: str, name: str | None, path: Path) -> str:
    """The suffix of a reader for a file: by its name, the type that was said, or its first bytes. 415 for none."""
    suffix = Path(name).suffix.lower() if name and "\0" not in name else ""
    if suffix in SUFFIXES:
        return suffix
    if kind in TYPES:
        return TYPES[kind]
    with path.open("rb") as stream:
        head = stream.read(8)
    if not head:
        raise InputError("body: expected a cloud, a depth image or a mesh; got none")
    known = next((suffix for magic, suffix in _MAGIC.items() if head.startswith(magic)), None)
    if known is not None and (kind in _ANY or suffix or name):
        return known
    if kind in _ANY and head.lstrip().startswith(b"{"):
        return ".json"
    got = f"a file called *{suffix[:20]}" if suffix else kind[:60] or "no Content-Type"
    raise HTTPException(415, f"body: expected {MULTIPART} or one of {', '.join(TYPES)}; got {got}")


def settings_of(pairs: Iterable[tuple[str, str]]) -> dict[str, Any]:
    """Settings in an address or a form; values as on the command line: `find`, `0,0,1,0`, `[0,0,1,0]`, `0.002`."""
    settings: dict[str, Any] = {}
    for given, words in pairs:
        key = named(given)
        if key in settings:
            raise InputError(f"{given}: expected one value, got several")
        settings[key] = value_of(words)
    return settings


def named(key: str) -> str:
    """The setting that a key means. Raises InputError for one that there is not, or that names files."""
    name = ALIASES.get(key, key)
    if name in FILES and name != "intrinsics":
        raise InputError(
            f"{key}: expected a file in the request, a part of {MULTIPART}; got text, and no file is read here"
        )
    if name not in SETTINGS:
        near = get_close_matches(name, [*SETTINGS, *ALIASES], 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise InputError(f"{key[:40]}: expected a setting of a scene, top or types; got an unknown one{hint}")
    return name


def value_of(words: str) -> Any:
    """A number, also one that begins with its point, a list or a word."""
    given = re.sub(r"(?<![\w.])(?=\.\d)", "0", words)  # JSON has no .45
    for text in (given, f"[{given}]") if "," in given else (given,):
        try:
            return json.loads(text)
        except (ValueError, RecursionError):
            pass
    return words


def bounded(receive: Receive, most: int, seconds: float) -> Receive:
    """`receive` of at most so many bytes of a body, in so many seconds from now.

    Of a body that is too large `DRAINED` times the most is read and dropped, so that whoever sends it hears of it.
    """
    got, end = 0, asyncio.get_running_loop().time() + seconds

    async def next_part() -> MutableMapping[str, Any]:
        try:
            async with asyncio.timeout_at(end):
                return await receive()
        except TimeoutError:
            raise HTTPException(408, f"body: expected all of it within {seconds:g} s, got {got} bytes") from None

    async def bounded_receive() -> MutableMapping[str, Any]:
        nonlocal got
        message = await next_part()
        got += len(message.get("body", b""))
        if got <= most:
            return message
        while message.get("more_body") and got <= DRAINED * most:
            message = await next_part()
            got += len(message.get("body", b""))
        raise HTTPException(413, f"body: expected at most {most} bytes (largest_mb), got more")

    return bounded_receive
