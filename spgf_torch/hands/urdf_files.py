"""The files of a hand: its URDF, through xacro where it is one, and the meshes that it names."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

from spgf_torch.errors import InputError
from spgf_torch.extras import needed
from spgf_torch.files.reading import LARGEST_XML, existing, unreadable, xml_root
from spgf_torch.hands.config import HandConfig
from spgf_torch.paths import find

WHAT = "a URDF of a hand"
PACKAGE = "package://"
XACRO = "xacro"
# Root elements of the other formats that people have hands in.
OTHERS = {
    "mujoco": "an MJCF file of MuJoCo; most hands have a URDF as well",
    "sdf": "an SDF file of Gazebo; most hands have a URDF as well",
    "COLLADA": "a COLLADA mesh",
}


def urdf_root(config: HandConfig) -> tuple[Path, ElementTree.Element]:
    """The file that `hand.urdf` names and its `<robot>`, xacro expanded.

    Raises InputError for one that is missing, too large, no URDF, or a xacro file that does not expand.
    """
    path = _given(config).resolve()  # workers may stand in another folder
    if (size := existing(path).stat().st_size) > LARGEST_XML:
        raise InputError(f"{path}: expected {WHAT} of at most {LARGEST_XML} bytes, got {size}")
    root = xml_root(path.read_bytes(), path, WHAT)
    if path.suffix.lower() == ".xacro" or any(f"/{XACRO}}}" in element.tag for element in root.iter()):
        root = xml_root(_expanded(path, config.packages), path, WHAT)
    if root.tag != "robot":
        raise InputError(f"{path}: expected {WHAT}, got {OTHERS.get(root.tag, f'a file of <{root.tag}>')}")
    return path, root


def mesh_file(name: str, urdf: Path, packages: dict[str, str]) -> Path:
    """The file of a mesh that a URDF calls `name`.

    Args:
        name: a path relative to the URDF's folder or absolute, `file://PATH`, or `package://NAME/PATH`.
        packages: NAME -> folder; packages that are not in it are looked for in `ROS_PACKAGE_PATH` and
            `AMENT_PREFIX_PATH`, and as folders NAME and packages/NAME in the URDF's folder and those above.

    Raises InputError with the places looked at where there is none.
    """
    if name.startswith(PACKAGE):
        return _in_package(name, urdf, packages)
    if "://" in name and not name.startswith("file:"):
        raise InputError(f"{urdf}: expected the file of a mesh, package://NAME/FILE or file://FILE; got {name}")
    path = Path(unquote(name.removeprefix("file:"))) if name.startswith("file:") else Path(name)
    if path.is_absolute():
        path = Path("/", *path.parts[1:])  # file:///a and file:////a are /a
    found = urdf.parent / path
    if not found.is_file():
        raise InputError(f"{urdf}: expected the mesh {name}, got no file {found}")
    return found


def _given(config: HandConfig) -> Path:
    if config.urdf.startswith(PACKAGE):
        return _in_package(config.urdf, Path.cwd() / "hand", config.packages)
    path = find(config.urdf)
    if not path.is_file():
        raise InputError(f"hand.urdf: expected a URDF file, got {config.urdf or 'none'}")
    return path


def _in_package(name: str, urdf: Path, packages: dict[str, str]) -> Path:
    package, _, rest = name.removeprefix(PACKAGE).partition("/")
    if not package or not rest:
        raise InputError(f"{urdf}: expected package://NAME/FILE, got {name}")
    for folder in _folders(package, urdf, packages):
        if (folder / rest).is_file():
            return folder / rest
    if package in packages:
        raise InputError(f"{urdf}: expected {rest} in hand.packages.{package}, got none in {packages[package]}")
    raise _not_found(f"{urdf}: expected the file {name}, got none", package, urdf)


def _folders(package: str, urdf: Path, packages: dict[str, str]) -> Iterator[Path]:
    """Where a package may be."""
    if package in packages:
        yield find(packages[package])
        return
    for entry in _listed("ROS_PACKAGE_PATH"):
        if entry.name == package:
            yield entry
        yield entry / package
        yield from sorted(entry.glob(f"*/{package}"))  # a repository of several packages in a workspace
    for entry in _listed("AMENT_PREFIX_PATH"):
        yield entry / "share" / package
    for parent in urdf.parents:
        if parent.name == package:
            yield parent
        yield parent / package
        yield parent / "packages" / package


def _listed(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _expanded(path: Path, packages: dict[str, str]) -> bytes:
    """The URDF that a xacro file makes with its default arguments; what it includes is looked for as meshes are."""
    needed(f"{path}: a xacro file", "xacrodoc")
    from xacrodoc import XacroDoc
    from xacrodoc import packages as finder

    known: dict[str, str] = {}
    while True:
        finder.reset()
        finder.update_package_cache(known)
        try:  # included, so that files which it includes itself are relative to it
            return bytes(XacroDoc.from_includes([path], resolve_packages=False).dom.toxml(encoding="utf-8"))
        except Exception as error:  # whatever an expression in the file raises
            if not isinstance(error.__context__, finder.PackageNotFoundError):
                raise unreadable(path, "a xacro file of a hand", error) from None
            package = str(error.__context__.args[0])
        folder = next((folder for folder in _folders(package, path, packages) if folder.is_dir()), None)
        if folder is None or package in known:
            raise _not_found(f"{path}: expected the package {package}, got none", package, path)
        known[package] = str(folder)


def _not_found(told: str, package: str, urdf: Path) -> InputError:
    return InputError(
        f"{told} in ROS_PACKAGE_PATH or AMENT_PREFIX_PATH, nor as {package} or packages/{package} in {urdf.parent} or "
        f"above; hand.packages.{package} may name its folder"
    )
