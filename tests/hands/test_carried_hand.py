"""The hand that a model's folder carries: the same by digest, wherever the folder lies and its own URDF is gone."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import trimesh
import yaml

from spgf_torch.errors import InputError
from spgf_torch.files.digests import KEY, sealed_json
from spgf_torch.hands.carried_hand import carry, found, load_carried
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.paths import find
from spgf_torch.settings import typed

PANDA = typed(HandConfig, yaml.safe_load(find("conf/hand/panda.yaml").read_text()))


@pytest.fixture
def own(tmp_path: Path) -> HandConfig:
    """The Panda with a mesh for its palm, of a package, and a visual shape whose file is nowhere."""
    folder = tmp_path / "robot"
    (folder / "meshes").mkdir(parents=True)
    trimesh.creation.box((0.06, 0.2, 0.05)).export(folder / "meshes/palm.stl")
    text = find(PANDA.urdf).read_text()
    mesh = '<geometry><mesh filename="package://robot/meshes/palm.stl"/></geometry>'
    seen = '<visual><geometry><mesh filename="nowhere.dae"/></geometry></visual>'
    start = text.index("<geometry>")
    link = text.index(">", text.index('<link name="panda_hand"')) + 1
    end = text.index("</geometry>") + len("</geometry>")
    (folder / "own.urdf").write_text(text[:link] + seen + text[link:start] + mesh + text[end:])
    return replace(PANDA, urdf=str(folder / "own.urdf"), packages={"robot": str(folder)})


def test_a_hand_with_meshes_is_found_when_its_own_files_are_gone(own: HandConfig, tmp_path: Path) -> None:
    hand = load_hand(own)
    carry(hand, tmp_path / "model")
    shutil.rmtree(tmp_path / "robot")
    moved = (tmp_path / "model").rename(tmp_path / "elsewhere")
    again = load_carried(own, moved)
    assert again.digest == hand.digest and again.robot.digest == hand.robot.digest
    assert {file.name for file in (moved / "hand").iterdir()} == {"hand.json", "own.urdf", "0_palm.stl"}
    assert found(own, moved).urdf == str(moved / "hand/own.urdf") and found(PANDA, moved) is PANDA
    with pytest.raises(InputError, match="expected a URDF file"):
        load_carried(own, tmp_path)


@pytest.mark.parametrize("change", ["urdf", "mesh", "description", "digest", "place", "no urdf"])
def test_another_hand_is_refused(own: HandConfig, tmp_path: Path, change: str) -> None:
    carry(load_hand(own), tmp_path)
    place, asked = tmp_path / "hand", own
    about = json.loads((place / "hand.json").read_text())
    about.pop(KEY)
    if change == "urdf":
        (place / "own.urdf").write_text((place / "own.urdf").read_text().replace("0.04", "0.039"))
    elif change == "mesh":
        trimesh.creation.box((0.06, 0.2, 0.06)).export(place / "0_palm.stl")
    elif change == "description":
        asked = replace(own, name="other")
    elif change == "digest":
        (place / "hand.json").write_bytes(sealed_json({**about, "digest": "0" * 64}))
    elif change == "place":
        (place / "hand.json").write_bytes(sealed_json({**about, "urdf": "../hand/own.urdf"}))
    else:
        (place / "own.urdf").unlink()
    with pytest.raises(InputError, match="expected") as refused:
        load_carried(asked, tmp_path)
    assert "\n" not in str(refused.value)


def test_a_folder_without_a_hand_takes_the_descriptions(tmp_path: Path) -> None:
    assert load_carried(PANDA, tmp_path).urdf == find(PANDA.urdf).resolve()
