"""The hand that a model's folder carries: URDF and meshes in `hand/`, so that the folder is all that a model needs.

`hand.json` says where the URDF is and the digest of the hand, which covers URDF, meshes and description. Visual shapes
are left out: nothing here reads them.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

from spgf_torch.errors import InputError
from spgf_torch.files.digests import sealed_json
from spgf_torch.files.reading import json_values
from spgf_torch.files.writing import write_bytes
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand, load_hand
from spgf_torch.hands.urdf_files import mesh_file, urdf_root
from spgf_torch.paths import find

FOLDER, ABOUT = "hand", "hand.json"
FORMAT = "spgf_torch hand"


def carry(hand: Hand, folder: Path) -> None:
    """Write the URDF and the collision meshes of a hand into the folder `hand` in `folder`, made anew.

    Raises InputError where what was written is not the same hand, as when a mesh names files of its own.
    """
    own = folder / FOLDER
    if own.exists():
        shutil.rmtree(own)
    own.mkdir(parents=True)
    path, root = urdf_root(hand.config)
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    for number, mesh in enumerate(root.iter("mesh")):
        file = mesh_file(mesh.get("filename", ""), path, hand.config.packages)
        mesh.set("filename", f"{number}_{file.name}")
        shutil.copyfile(file, own / f"{number}_{file.name}")
    urdf = f"{path.name.split('.')[0] if path.suffix == '.xacro' else path.stem}.urdf"
    root.set("name", root.get("name", path.stem))
    write_bytes(own / urdf, ElementTree.tostring(root, encoding="utf-8") + b"\n")
    about = {"format": FORMAT, "name": hand.config.name, "urdf": urdf, "digest": hand.digest}
    write_bytes(own / ABOUT, sealed_json(about, indent=1, sort_keys=True))
    load_carried(hand.config, folder)


def found(config: HandConfig, folder: Path) -> HandConfig:
    """The description with the URDF that a model's folder carries, where its own is gone; else as it is."""
    if find(config.urdf).is_file() or "://" in config.urdf or not (folder / FOLDER / ABOUT).is_file():
        return config
    return load_carried(config, folder).config


def load_carried(config: HandConfig, folder: Path) -> Hand:
    """The hand of a model in `folder`, by the URDF that it carries; by the description's own if it carries none.

    Raises InputError where it is not the hand that the model learned with.
    """
    path = folder / FOLDER / ABOUT
    if not path.is_file():
        return load_hand(config)
    about = json_values(path, "a hand's JSON", sealed=True)
    known = about if isinstance(about, dict) else {}
    urdf, digest = known.get("urdf"), known.get("digest")
    if known.get("format") != FORMAT or not isinstance(urdf, str) or urdf != Path(urdf).name:
        raise InputError(f"{path}: expected format {FORMAT!r} with the name of a URDF beside it, got something else")
    hand = load_hand(replace(config, urdf=str((folder / FOLDER / urdf).resolve()), packages={}))
    if hand.digest != digest:
        raise InputError(
            f"{path}: expected the hand that the model learned with, got a changed URDF, mesh or description"
        )
    return hand
