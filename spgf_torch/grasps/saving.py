"""Grasps as files, by the names of formats: what `Grasps.save` and `python -m spgf_torch.predict` write."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

from spgf_torch.errors import InputError
from spgf_torch.paths import path_of

if TYPE_CHECKING:
    from spgf_torch.grasps.grasps import Grasps
    from spgf_torch.hands.records import Grasp


def save(
    grasps: Grasps, folder: str | Path, formats: str | Sequence[str] | None = None, replace: bool = False
) -> list[Path]:
    """Write the formats into a folder, and return the paths; see `Grasps.save`."""
    wanted = chosen(formats)
    if not isinstance(replace, bool):
        raise InputError(f"replace: expected True or False, got {replace!r:.40}")
    if PAGE in wanted:
        if grasps.source is None:
            raise InputError("formats: expected grasps that a model predicted for a page, got some without their scene")
        if not len(grasps.source.scene.texlets):
            raise InputError("formats: expected a scene that shows something for a page, got one without texlets")
    place = path_of("folder", folder)
    there = [name for each in wanted for name in NAMES[each] if (place / name).exists()]
    if there and not replace:
        raise InputError(
            f"folder: expected one without {there[0]}, got {place}, which has it; replace=True replaces it"
        )
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"folder: expected a folder, or none yet, got {place}: {error.strerror}") from None
    return [path for name in wanted for path in _WRITERS[name](grasps, place)]


def chosen(formats: str | Sequence[str] | None) -> list[str]:
    """The formats that are meant, each once. Raises InputError for an unknown one, and names the nearest."""
    if formats is None:
        return list(FILES)
    if not isinstance(formats, Iterable):
        raise InputError(f"formats: expected some of {', '.join(_WRITERS)}; got {formats!r:.40}")
    names = [formats] if isinstance(formats, str) else list(formats)
    for name in names:
        if name not in _WRITERS:
            near = get_close_matches(str(name).lower(), _WRITERS, 1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise InputError(f"formats: expected some of {', '.join(_WRITERS)}; got {name!r:.40}{hint}")
    if not names:
        raise InputError(f"formats: expected some of {', '.join(_WRITERS)}; got none")
    return list(dict.fromkeys(names))


def left_out(grasps: Grasps) -> str | None:
    """What graspnetAPI's array, which knows two-finger jaws alone, cannot say, in a line; None: it says all."""
    left = len(grasps) - len(_jaws(grasps))
    if not left:
        return None
    return f"graspnet.npy: {left} grasps left out, of types that are no two-finger jaw; the other files have them"


def _jaws(grasps: Grasps) -> list[Grasp]:
    return [grasp for grasp in grasps if grasps.grippers[grasp.type].jaw]


def _json(grasps: Grasps, folder: Path) -> list[Path]:
    from spgf_torch.formats.grasps_json import write_grasps

    path = folder / NAMES["json"][0]
    write_grasps(path, grasps, grasps.grippers, grasps.judge_said(), grasps.model, grasps.notes)
    return [path]


def _isaac(grasps: Grasps, folder: Path) -> list[Path]:
    from spgf_torch.formats.isaac import write_isaac

    path = folder / NAMES["isaac"][0]
    write_isaac(path, grasps, grasps.grippers)
    return [path]


def _moveit(grasps: Grasps, folder: Path) -> list[Path]:
    from spgf_torch.ros.grasps import write_moveit

    path = folder / NAMES["moveit"][0]
    write_moveit(path, grasps, grasps.grippers)
    return [path]


def _graspnet(grasps: Grasps, folder: Path) -> list[Path]:
    from spgf_torch.formats.graspnet import joints_path, write_graspnet

    path = folder / NAMES["graspnet"][0]
    write_graspnet(path, _jaws(grasps), grasps.grippers)
    return [path, joints_path(path)]


def _glb(grasps: Grasps, folder: Path) -> list[Path]:
    from spgf_torch.formats.glb import Surroundings, write_glb

    path, beside = folder / NAMES["glb"][0], None
    if (source := grasps.source) is not None:
        scene, T = source.scene, source.T_grasps_scene
        seen = (scene.texlets.positions, scene.texlets.normals, scene.obstacles)
        positions, normals, obstacles = (part.double().cpu().numpy() for part in seen)
        colours = None if scene.sensed is None else scene.sensed.colours_at(positions)
        beside = Surroundings(positions, normals, scene.spacing, obstacles, scene.table, colours).transform(T)
    write_glb(path, grasps, grasps.grippers, beside)
    return [path]


def _page(grasps: Grasps, folder: Path) -> list[Path]:
    from spgf_torch.grasps.page import write_page

    return write_page(grasps, folder)


PAGE = "page"
# What each format is called in the folder.
NAMES = {
    "json": ("grasps.json",),
    "isaac": ("isaac_grasp.yaml",),
    "moveit": ("moveit_grasps.json",),
    "graspnet": ("graspnet.npy", "graspnet.joints.json"),
    "glb": ("grasps.glb",),
    PAGE: ("index.html", "grasps.png"),
}
_WRITERS: dict[str, Callable[[Grasps, Path], list[Path]]] = {
    "json": _json,
    "isaac": _isaac,
    "moveit": _moveit,
    "graspnet": _graspnet,
    "glb": _glb,
    PAGE: _page,
}
# Those that other programs read.
FILES = tuple(name for name in _WRITERS if name != PAGE)
