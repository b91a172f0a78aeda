"""Hands whose URDF or settings are damaged, foreign, or made to hurt."""

from pathlib import Path
from typing import Any

import pytest
from hostile import ROOT, Case, Write, nothing, raw, table, told

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.settings import settings

HAND = (ROOT / "data/hands/panda.urdf").read_text()
ENTITIES = "<!DOCTYPE r [<!ENTITY a 'lol'>" + "".join(
    f"<!ENTITY {y} '{f'&{x};' * 10}'>" for x, y in zip("abcdefghi", "bcdefghij", strict=True)
)


def swapped(old: str, new: str, count: int = 1) -> Write:
    assert old in HAND
    return raw(HAND.replace(old, new, count))


MESH = '<box size="0.063 0.208 0.092"/>'
HANDS: list[tuple[str, Write, str]] = [
    ("missing", nothing, "URDF"),
    ("empty", raw(b""), "empty"),
    ("bytes", raw(bytes(range(256))), "URDF"),
    ("cut", raw(HAND[: len(HAND) // 2]), "URDF"),
    ("no robot", raw("<a/>"), ""),
    ("a robot of nothing", raw("<robot name='a'/>"), ""),
    ("a billion laughs", raw(ENTITIES + "]><robot name='&j;'/>"), "URDF"),
    ("an entity of a file", raw("<!DOCTYPE r [<!ENTITY a SYSTEM 'file:///etc/passwd'>]>" + HAND.split("?>")[1]
     .replace("panda_hand", "&a;")), ""),
    ("another root", swapped('<robot name="panda_hand">', '<robot name="panda_hand"><link name="more"/>'), ""),
    ("a link in a ring", swapped('<child link="panda_leftfinger"/>', '<child link="panda_hand"/>'), ""),
    ("a parent that is not there", swapped('<parent link="panda_hand"/>', '<parent link="arm"/>'), ""),
    ("a link less", swapped('name="panda_leftfinger"', 'name="left"'), ""),
    ("limits of words", swapped('lower="0" upper="0.04"', 'lower="a" upper="b"'), "panda_finger_joint1: lower"),
    ("limits of NaN", swapped('lower="0" upper="0.04"', 'lower="nan" upper="nan"', 2), "limits"),
    ("limits of infinity", swapped('lower="0" upper="0.04"', 'lower="-inf" upper="inf"', 2), ""),
    ("limits upside down", swapped('lower="0" upper="0.04"', 'lower="1" upper="0"', 2), "limits"),
    ("an axis of 0", swapped('axis xyz="0 1 0"', 'axis xyz="0 0 0"'), ""),
    ("a box of words", swapped(MESH, '<box size="a b c"/>'), "box size"),
    ("a box of two sides", swapped(MESH, '<box size="1 2"/>'), ""),
    ("a box of NaN", swapped(MESH, '<box size="nan nan nan"/>'), ""),
    ("a cylinder of nothing", swapped(MESH, "<cylinder/>"), ""),
    ("no shape", swapped(MESH, ""), ""),
    ("a mesh that is not there", swapped(MESH, '<mesh filename="palm.stl"/>'), "palm.stl"),
    ("a mesh that climbs", swapped(MESH, '<mesh filename="../secret.stl"/>'), "secret.stl"),
    ("a mesh of an absolute path", swapped(MESH, f'<mesh filename="{ROOT}/README.md"/>'), "README.md"),
    ("a mesh of a package", swapped(MESH, '<mesh filename="package://arm/palm.stl"/>'), "palm.stl"),
    ("a mesh on the net", swapped(MESH, '<mesh filename="https://example.com/palm.stl"/>'), "palm.stl"),
    ("a mesh that is torn", swapped(MESH, '<mesh filename="torn.stl"/>'), "torn.stl"),
    ("a document type", raw(HAND.replace("<robot", "<!DOCTYPE robot><robot", 1)), "document type"),
    ("17 MB", raw(HAND + " " * 17_000_000), "bytes"),
    ("a hundred levels", raw("<robot name='a'>" + "<a>" * 100 + "</a>" * 100 + "</robot>"), "levels"),
    ("a mesh that is flat", swapped(MESH, '<mesh filename="flat.obj"/>'), "flat.obj"),
]  # fmt: skip


@table([Case(f"hand {name}", {}, write, (word,)) for name, write, word in HANDS])
def test_hands(case: Case, own_folder: Path, capsys: pytest.CaptureFixture) -> None:
    from omegaconf import OmegaConf

    Path("hand").mkdir()
    (Path("secret.stl")).write_text("solid a")
    Path("hand/torn.stl").write_bytes(bytes(84))
    Path("hand/flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    case.write(Path("hand/hand.urdf"))
    values = OmegaConf.to_container(OmegaConf.load(ROOT / "conf/hand/panda.yaml"))
    config = settings(HandConfig, **{**values, "urdf": str(own_folder / "hand/hand.urdf")})
    told("simulate", lambda: load_hand(config), (*case.words, "expected", "got"), capsys)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"urdf": "hand\0.urdf"}, "zero"),
        ({"urdf": "../../../etc/passwd"}, "URDF"),
        ({"urdf": "/dev/zero"}, "URDF"),
        ({"urdf": "."}, "URDF"),
        ({"urdf": "a" * 5000}, "name"),
        ({"preshapes": {"NPG": {"hold": {"panda_finger_joint1": 1e300}}}}, "limits"),
        ({"preshapes": {"NPG": {"open": {"panda_finger_joint1": -0.01}}}}, "limits"),
        ({"preshapes": {"NPG": {"opening": 1e300}}}, "opening"),
        ({"preshapes": {"NPG": {"opening": -0.01}}}, "opening"),
        ({"preshapes": ["NPG"]}, "preshapes"),
        ({"approach": [float("nan"), 0, 1]}, "approach"),
        ({"closing": {"effort": float("inf")}}, "effort"),
        ({"fingers": {"left": ["panda_leftfinger"]}}, "fingers"),
        ({"fingers": {f"f{i}": ["panda_leftfinger"] for i in range(100)}}, "fingers"),
    ],
)
def test_settings_of_a_hand(changes: dict[str, Any], word: str, capsys: pytest.CaptureFixture) -> None:
    from omegaconf import OmegaConf

    values = OmegaConf.to_container(OmegaConf.load(ROOT / "conf/hand/panda.yaml"))
    told(
        "simulate",
        lambda: load_hand(settings(HandConfig, **{**values, **changes})),
        (word, "expected", "got"),
        capsys,
    )
