"""Objects that a program gives one by one, as a folder that a training reads, and that can be read again."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import trimesh
from trimesh.exchange.obj import export_obj

from spgf_torch.errors import InputError
from spgf_torch.objects.manifest import check_name
from spgf_torch.objects.scans import SUFFIXES

FOLDER = "objects"
DIGITS = 10  # decimals of vertices in m


def kept_objects(objects: Any, folder: Path) -> str:
    """The folder with the objects: the one that was given, or `objects` in the run's, with a copy of each mesh.

    Args:
        objects: a folder; or meshes, files of meshes or both: a list, where files have their own names and meshes
            are `object_1`, `object_2`, ..., or a mapping by name.

    Raises InputError for anything else, for none, and for two of one name.
    """
    if isinstance(objects, str | Path):
        return str(objects)
    if not isinstance(objects, Mapping | Iterable) or isinstance(objects, trimesh.Trimesh):
        raise InputError(f"objects: expected a folder, or a list of meshes, got {type(objects).__name__}")
    named = _named(objects)
    if not named:
        raise InputError("objects: expected a mesh at least, got none")
    (folder / FOLDER).mkdir()
    taken: set[str] = set()
    for name, given in named:
        check_name(str(name), "objects")
        if name in taken:
            raise InputError(f"objects: expected each name once, got {name} twice")
        taken.add(name)
        _keep(name, given, folder / FOLDER)
    return str(folder / FOLDER)


@contextmanager
def in_their_names(objects: Any, folder: Path) -> Iterator[None]:
    """What is refused within of a copy that `kept_objects` made is told by the file, or the mesh, that was given."""
    try:
        yield
    except InputError as error:
        line = str(error)
        for name, given in _named(objects) if isinstance(objects, Mapping | list | tuple) else ():
            suffix = Path(given).suffix.lower() if isinstance(given, str | Path) else ".obj"
            words = str(given) if isinstance(given, str | Path) else f"objects: {name}"
            line = line.replace(str(folder / FOLDER / f"{name}{suffix}"), words)
        raise InputError(line) from None


def _named(objects: Mapping[Any, Any] | Iterable[Any]) -> list[tuple[str, Any]]:
    """A name for each."""
    if isinstance(objects, Mapping):
        return list(objects.items())
    return [
        (re.sub(r"[^A-Za-z0-9_-]", "_", Path(given).stem), given)
        if isinstance(given, str | Path)
        else (f"object_{number}", given)
        for number, given in enumerate(objects, 1)
    ]


def _keep(name: str, given: Any, folder: Path) -> None:
    """One mesh, as it is; its material and colours, which nobody looks at, stay behind."""
    if isinstance(given, trimesh.Trimesh):
        content = export_obj(given, include_normals=False, include_color=False, include_texture=False, digits=DIGITS)
        (folder / f"{name}.obj").write_text(content, encoding="utf-8")
        return
    if not isinstance(given, str | Path):
        raise InputError(f"objects: expected a mesh or a file of one for {name}, got {type(given).__name__}")
    file = Path(given).expanduser()
    if file.suffix.lower() not in SUFFIXES or not file.is_file():
        got = "no such file" if file.suffix.lower() in SUFFIXES else file.suffix or "no suffix"
        raise InputError(f"objects: expected a file that ends with {', '.join(SUFFIXES)}, got {got}: {file}")
    shutil.copy(file, folder / f"{name}{file.suffix.lower()}")
