"""The process that predicts: it loads the model once, and answers one request after the other.

It is apart from the server, so that a prediction can be ended, and nothing that a file does to a reader ends the server
itself.
"""

from __future__ import annotations

import gc
import json
import resource
import secrets
import tempfile
import time
import warnings
from collections import OrderedDict
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spgf_torch import __version__
from spgf_torch.errors import InputError
from spgf_torch.serving.bodies import OWN, Job, named
from spgf_torch.serving.config import ServeConfig
from spgf_torch.simulation.worker_process import limited

if TYPE_CHECKING:
    from spgf_torch.grasps.grasps import Grasps
    from spgf_torch.predictor import Predictor
    from spgf_torch.scene.scene import Scene

# What a JSON object holds besides settings, in the words of Scene.from_points and from_depth.
ARRAYS = {
    "points": ("points", "normals", "viewpoints", "mask", "segments"),
    "depth": ("depth", "K", "T_input_camera", "mask", "segments"),
}
# Settings that would be passed over in silence.
UNUSED = {
    "points": ("intrinsics", "stride", "depth_scale", "read_as", "mesh"),
    "depth": ("intrinsics", "viewpoints", "read_as", "mesh"),
}
# Other words for these keys.
WORDS = {"viewpoint": "viewpoints", "intrinsics": "K"}
# Grasps of each type at most, as of predict.
MOST_TOP = 1000
# The seconds after which no page is worth waiting for: it takes some three, most of them once.
PAGE_SECONDS = 60.0


@dataclass(frozen=True)
class Answer:
    """Grasps as JSON text; how many they are, and the name of the result."""

    body: bytes
    count: int
    name: str


class TooLargeError(Exception):
    """A request wanted more memory than it may have."""


@dataclass
class _Loaded:
    """What the process keeps: the model, who it is in words, its settings, and the latest results by their names, each
    with what its page says in its head."""

    model: Predictor
    about: dict[str, Any]
    config: ServeConfig
    results: OrderedDict[str, tuple[Grasps, list[tuple[str, str]]]] = field(default_factory=OrderedDict)


_loaded: list[_Loaded] = []


def load(config: ServeConfig) -> dict[str, Any] | InputError:
    """Load the model and do what the first prediction would; returns who it is."""
    from spgf_torch.predictor import Predictor

    try:
        how = (config.device, config.proposing, config.retreat, config.judge)
        model = Predictor.load(str(config.model), *how).ready()
        about = identity(model)
    except InputError as error:
        return error
    _loaded[:] = [_Loaded(model, about, config)]
    gc.freeze()  # what is there now stays: it is looked at no more
    _bound_memory(config.memory_gb)
    return about


def identity(model: Predictor) -> dict[str, Any]:
    """Which model this is, without where it lies: its folder's name, hand, types, digests, the program's version."""
    from spgf_torch.files.digests import digest_of
    from spgf_torch.files.given_paths import JUDGE, MODEL

    parts = ((model.folder, MODEL), (model.judge_folder, JUDGE))
    files = [folder / name for folder, names in parts if folder is not None for name in names]
    hand = next(iter(model.grippers.values()))
    return {
        "name": files[0].resolve().parent.name,
        "hand": hand.name.removesuffix(f"_{hand.type}"),
        "types": sorted(model.grippers),
        "ranked_by": "judge" if model.judged is not None else "votes",
        "digest": {path.name: digest_of(path) for path in files},
        "version": __version__,
    }


def predict(job: Job) -> Answer | InputError | TooLargeError:
    """The grasps that a request asks for; what cannot be used is returned, not raised."""
    state = _loaded[0]
    try:
        with limited(state.config.seconds):
            return _answer(job, state)
    except InputError as error:
        return InputError(_as_called(str(error), job))
    except (MemoryError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and "allocate memory" not in str(error):
            raise
        gc.collect()
        return TooLargeError(
            f"expected a request of at most {state.config.memory_gb:g} GB while it is predicted (memory_gb), got more"
        )


def page(name: str) -> bytes | InputError | None:
    """The page of a result, `last` or one that an answer named; None where it is kept no more."""
    state = _loaded[0]
    found = next(reversed(state.results.values()), None) if name == "last" else state.results.get(name)
    if found is None:
        return None
    from spgf_torch.grasps.page import write_page

    grasps, head = found
    try:
        with limited(PAGE_SECONDS), tempfile.TemporaryDirectory(prefix="spgf_page_") as folder:
            pages = [path for path in write_page(grasps, Path(folder), head) if path.suffix == ".html"]
            return pages[0].read_bytes() if pages else InputError("page: expected something seen, got an empty scene")
    except InputError as error:
        return error


def _answer(job: Job, state: _Loaded) -> Answer:
    settings = dict(job.settings)
    values: dict[str, Any] = {}
    if job.arrays:
        values, more = _json_parts(Path(job.folder) / job.files["input"][0])
        if twice := sorted((more.keys() | values.keys()) & settings.keys()):
            raise InputError(f"{twice[0]}: expected one value, got one in the address and one in the body")
        settings |= more
        kind = "points" if "points" in values else "depth"
        if unused := [key for key in UNUSED[kind] if key in settings]:
            raise InputError(f"{unused[0]}: expected with other input than {kind} in JSON, got it with these")
    top, types = _own(settings, state)
    start = time.perf_counter()
    scene = _in_their_words(_scene(job, values, settings, state), job)
    sensed = time.perf_counter()
    grasps = state.model.predict(scene, top)
    seconds = {"scene": sensed - start, "grasps": time.perf_counter() - sensed}
    if types is not None:
        grasps = replace(grasps, grasps=tuple(grasp for grasp in grasps if grasp.type in types))
    file = ", ".join(job.called.get(name, name) for name in job.files["input"])
    return _told(grasps, scene, seconds, state, file)


def _told(grasps: Grasps, scene: Scene, seconds: dict[str, float], state: _Loaded, file: str) -> Answer:
    """The dictionary of grasps.json and what else there is to say, as JSON; the result is kept."""
    from spgf_torch.grasps.page import head_of

    name = secrets.token_hex(8)
    state.results[name] = grasps, head_of(state.model, file, version=f"spgf_torch {__version__}")
    while len(state.results) > state.config.kept:
        state.results.popitem(last=False)
    said = grasps.to_dict()
    if "judge" in said:  # where it lies is the server's own
        said["judge"] = {**said["judge"], "folder": Path(said["judge"]["folder"]).name}
    beside = {
        "id": name,
        "page": f"/results/{name}/page",
        "model": state.about,
        "seconds": {key: round(value, 4) for key, value in seconds.items()},
        "texlets": len(scene.texlets),
        "notes": list(scene.notes),
        "no_grasp": scene.no_grasp,
    }
    return Answer(json.dumps({**said, **beside}, allow_nan=False).encode(), len(grasps), name)


def _own(settings: dict[str, Any], state: _Loaded) -> tuple[int, tuple[str, ...] | None]:
    """Take `top` and `types` out of the settings; the rest is the scene's, and reads no more than the server allows."""
    top, types = (settings.pop(key, None) for key in OWN)
    if not isinstance(most := settings.get("max_points", 1), int) or most > state.config.max_points:
        raise InputError(f"max_points: expected a whole number up to {state.config.max_points}, got {most!r:.40}")
    settings.setdefault("max_points", state.config.max_points)
    if types is not None:
        types = (
            tuple(types.split(",")) if isinstance(types, str) else tuple(types) if isinstance(types, list) else (types,)
        )
        if unknown := [each for each in types if each not in state.model.grippers]:
            raise InputError(
                f"types: expected some of {', '.join(sorted(state.model.grippers))}; got {unknown[0]!r:.40}"
            )
    top = state.config.top if top is None else top
    if not isinstance(top, int) or isinstance(top, bool) or not 1 <= top <= MOST_TOP:
        raise InputError(f"top: expected a whole number from 1 to {MOST_TOP}, got {top!r:.40}")
    return top, types


def _json_parts(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The arrays of a JSON object, and the settings in it."""
    from spgf_torch.files.reading import json_values

    values = json_values(path, "a JSON object")
    if not isinstance(values, dict):
        raise InputError(f"body: expected a JSON object with points, or with depth and K; got {type(values).__name__}")
    kinds = [key for key in ARRAYS if key in values]
    if len(kinds) != 1:
        raise InputError(
            f"body: expected a JSON object with points, or with depth and K; got {' and '.join(kinds) or 'neither'}"
        )
    arrays: dict[str, Any] = {}
    settings: dict[str, Any] = {}
    for given, value in values.items():
        key = WORDS.get(given, given)
        if key not in ARRAYS[kinds[0]]:
            key = named(given)
        if key in arrays or key in settings:
            raise InputError(f"{given}: expected one value, got several")
        (arrays if key in ARRAYS[kinds[0]] else settings)[key] = value
    return arrays, settings


def _scene(job: Job, values: dict[str, Any], settings: dict[str, Any], state: _Loaded) -> Scene:
    """The scene in a request's arrays or files; what it warns of is in its notes."""
    from spgf_torch.scene.scene import Scene

    sensing = state.model.sensing
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        if job.arrays:
            from spgf_torch.serving.arrays import checked_arrays

            arrays = checked_arrays(values, settings["max_points"])
            if "points" in arrays:
                return Scene.from_points(arrays.pop("points"), **arrays, sensing=sensing, **settings)
            return Scene.from_depth(arrays.pop("depth"), arrays.pop("K", None), **arrays, sensing=sensing, **settings)
        folder = Path(job.folder)
        named_files = {key: [str(folder / name) for name in names] for key, names in job.files.items()}
        if twice := sorted(named_files.keys() & settings.keys()):
            raise InputError(f"{twice[0]}: expected a file or numbers, got both")
        files = named_files.pop("input", [])
        if isinstance(settings.get("intrinsics"), str):
            raise InputError("intrinsics: expected a file in the request or numbers (fx,fy,cx,cy), got text")
        lists = {key: files[0] if len(files) == 1 else files for key, files in named_files.items()}
        return Scene.from_files(files, sensing=sensing, **{**settings, **lists})


def _in_their_words(scene: Scene, job: Job) -> Scene:
    """The scene, in whose words files are called as in the request."""
    notes = tuple(_as_called(note, job) for note in scene.notes)
    no_grasp = scene.no_grasp and _as_called(scene.no_grasp, job)
    return replace(scene, notes=notes, unseen=_as_called(scene.unseen, job), no_grasp=no_grasp)


def _as_called(words: str, job: Job) -> str:
    """Words on files by what whoever asks calls them, without where they lie."""
    for name, called in job.called.items():
        words = words.replace(f"{job.folder}/{name}", called)
    return words.replace(f"{job.folder}/", "")


def _bound_memory(gigabytes: float) -> None:
    """Let this process take so much more memory; past it an allocation fails, and the request with it."""
    used = next(
        int(line.split()[1]) * 1024
        for line in Path("/proc/self/status").read_text().splitlines()
        if line.startswith("VmData:")
    )
    most = used + round(gigabytes * 1e9)
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
