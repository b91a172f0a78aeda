"""What is read of a URDF: root, joints, passive links, inertias; what is written for simulators; what is refused."""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from commands import ROOT

from spgf_torch.errors import InputError
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.robot import Follow, Robot
from spgf_torch.hands.urdf import read_robot

MASS = '<mass value="0.3"/><inertia ixx="0.004" ixy="0" ixz="0" iyy="0.003" iyz="0" izz="0.002"/>'
BOX = '<collision><geometry><box size="0.02 0.04 0.06"/></geometry></collision>'


def link(name: str, inside: str = f"<inertial>{MASS}</inertial>{BOX}") -> str:
    return f'<link name="{name}">{inside}</link>'


def joint(name: str, parent: str, child: str, inside: str = "", kind: str = "revolute") -> str:
    limit = "" if "<limit" in inside or kind in ("fixed", "continuous") else '<limit lower="-0.5" upper="1.5"/>'
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{limit}{inside}</joint>'


def read(folder: Path, *parts: str, **settings: object) -> Robot:
    file = folder / "hand.urdf"
    file.write_text(f'<robot name="small">{"".join(parts)}</robot>')
    return read_robot(HandConfig(name="small", urdf=str(file), **settings))


def refused(folder: Path, message: str, *parts: str, **settings: object) -> None:
    with pytest.raises(InputError, match=message) as error:
        read(folder, *parts, **settings)
    assert "\n" not in str(error.value)


JAW = (link("palm"), link("left"), link("right"), joint("a", "palm", "left"), joint("b", "palm", "right"))


def test_a_joint_as_its_urdf_says(tmp_path: Path) -> None:
    inside = (
        '<origin xyz="0.1 0.2 0.3" rpy="0 0 1.5707963267948966"/><axis xyz="0 3 4"/>'
        '<limit lower="-0.25" upper="0.75" effort="5" velocity="0"/>'
        '<mimic joint="b" multiplier="-0.676" offset="0.149"/>'
    )
    robot = read(tmp_path, link("palm"), link("left"), link("right"), joint("a", "palm", "left", inside),
                 joint("b", "palm", "right", '<axis xyz="0 0 -1"/>', "continuous"))  # fmt: skip
    a, b = robot.joints
    assert (a.name, a.kind, a.parent, a.child, a.moves) == ("a", "revolute", "palm", "left", True)
    assert np.allclose(a.T_parent_joint, [[0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1]], atol=1e-15)
    assert np.allclose(a.axis, [0, 0.6, 0.8]) and (a.lower, a.upper) == (-0.25, 0.75)
    assert (a.effort, a.velocity, a.mimic) == (5.0, None, Follow("b", -0.676, 0.149))
    assert (b.kind, b.lower, b.upper, b.effort, b.mimic) == ("continuous", -math.inf, math.inf, None, None)
    assert robot.bodies() == {"palm": "palm", "left": "left", "right": "right"}


def test_an_axis_that_is_not_given_is_x_and_offset_and_ratio_have_defaults(tmp_path: Path) -> None:
    inside = '<limit lower="0" upper="0.04" velocity="0.1"/><mimic joint="b"/>'
    robot = read(tmp_path, *JAW[:3], joint("a", "palm", "left", inside, "prismatic"), JAW[4])
    assert robot.joint("a").axis.tolist() == [1.0, 0.0, 0.0]
    assert robot.joint("a").mimic == Follow("b", 1.0, 0.0)
    assert '<axis xyz="1 0 0" />' in robot.xml  # pytorch-kinematics' own default is another


def test_the_root_is_past_links_that_hold_nothing(tmp_path: Path) -> None:
    world = (link("world", ""), link("mount", ""), joint("w", "world", "mount", kind="fixed"))
    robot = read(tmp_path, *world, joint("m", "mount", "palm", kind="fixed"), *JAW)
    assert robot.root == "palm" and robot.links == ("palm", "left", "right")
    assert [each.name for each in robot.joints] == ["a", "b"]
    assert read(tmp_path, *world, joint("m", "mount", "palm"), *JAW).root == "mount"  # the palm moves


def test_a_hand_at_the_end_of_an_arm(tmp_path: Path) -> None:
    arm = (link("base"), link("wrist"), joint("s", "base", "wrist"), joint("w", "wrist", "palm", kind="fixed"))
    robot = read(tmp_path, *arm, *JAW, root="palm")
    assert robot.links == ("palm", "left", "right") and "wrist" not in robot.xml
    assert robot.digest == read(tmp_path, *JAW).digest
    odd = (link("floor", ""), joint("f", "floor", "base", kind="floating"))  # above the hand anything goes
    assert read(tmp_path, *odd, *arm, *JAW, root="palm").digest == robot.digest
    refused(tmp_path, r"^hand.root: expected a link of .*hand.urdf, got plam; did you mean palm\?$", *JAW, root="plam")


def test_links_behind_fixed_joints_are_one_body(tmp_path: Path) -> None:
    tip = (link("tip", BOX), joint("t", "left", "tip", kind="fixed"))
    robot = read(tmp_path, *JAW, *tip)
    assert robot.bodies()["tip"] == "left"


FOUR_BAR = (
    *JAW[:4],
    joint("b", "palm", "right", '<mimic joint="a" multiplier="-1"/>'),
    link("inner"), link("inner_pin"), joint("i", "palm", "inner", '<mimic joint="a"/>'),
    joint("p", "inner", "inner_pin", kind="fixed"),
    link("tip"), joint("d", "left", "tip", '<mimic joint="a" multiplier="-1"/>'),
)  # fmt: skip
FINGERS = {"one": ["left"], "other": ["right"]}


def test_links_behind_mimic_joints_that_lead_to_no_finger_are_passive(tmp_path: Path) -> None:
    robot = read(tmp_path, *FOUR_BAR, fingers=FINGERS)
    assert robot.passive == {"inner", "inner_pin"}  # not the tip, which hangs from a finger
    assert "inner" in robot.xml and "mimic" not in robot.xml
    assert read(tmp_path, *FOUR_BAR, fingers={**FINGERS, "palm": ["palm"]}).passive == {"inner", "inner_pin"}
    assert read(tmp_path, *FOUR_BAR, fingers={"one": ["tip"], "other": "right"}).passive == {"inner", "inner_pin"}
    named = read(tmp_path, *FOUR_BAR, fingers=FINGERS, passive=[])
    assert named.passive == frozenset() and named.digest != robot.digest
    refused(tmp_path, r"hand.passive: expected a link of .*, got iner; did you mean inner", *FOUR_BAR, passive=["iner"])
    refused(tmp_path, r"hand.passive: .* no finger, got left$", *FOUR_BAR, fingers=FINGERS, passive=["left"])


def test_the_xml_has_nothing_but_the_hand_and_its_numbers_as_they_were(tmp_path: Path) -> None:
    inside = (
        '<dynamics damping="9"/><safety_controller k_velocity="1"/><origin rpy="0 0 0.50" xyz="1e-3 0 0"/>'
        '<axis xyz="0 1.0 0"/><limit lower="-0.10" upper="1.570796326794896619"/>'
    )
    mesh = '<visual><geometry><mesh filename="package://none/x.dae"/></geometry></visual>'
    robot = read(
        tmp_path,
        link("palm", f'<inertial><origin xyz="0 0 0.0370"/>{MASS}</inertial>{mesh}{BOX}'),
        JAW[1],
        joint("a", "palm", "left", inside),
        '<transmission type="SimpleTransmission" name="t"/><gazebo reference="palm"/><material name="m"/>',
        '<ros2_control name="r" type="system"><joint name="a"/></ros2_control>',
    )
    xml = ElementTree.fromstring(robot.xml)
    assert [part.tag for part in xml] == ["link", "link", "joint"]
    assert [part.tag for part in xml[0]] == ["inertial", "collision"]
    assert [(part.tag, part.attrib) for part in xml[2]] == [
        ("parent", {"link": "palm"}),
        ("child", {"link": "left"}),
        ("origin", {"rpy": "0 0 0.50", "xyz": "1e-3 0 0"}),
        ("axis", {"xyz": "0 1.0 0"}),
        ("limit", {"lower": "-0.10", "upper": "1.570796326794896619", "effort": "0", "velocity": "0"}),
    ]
    assert 'xyz="0 0 0.0370"' in robot.xml and 'value="0.3"' in robot.xml and robot.notes == ()


@pytest.mark.parametrize("name", ["sdh2", "panda"])
def test_numbers_of_the_shipped_hands_stay_the_text_that_they_were(name: str) -> None:
    file = ROOT / "data" / "hands" / f"{name}.urdf"
    robot = read_robot(HandConfig(name=name, urdf=str(file)))
    given, made = ElementTree.parse(file).getroot(), ElementTree.fromstring(robot.xml)
    for mimic in [(element, part) for element in given for part in element.findall("mimic")]:
        mimic[0].remove(mimic[1])

    def content(root: ElementTree.Element) -> list[str]:
        parts = [element for tag in ("link", "joint") for element in root.findall(tag)]
        return sorted(
            f"{part.get('name')} {each.tag} {sorted(each.attrib.items())}" for part in parts for each in part.iter()
        )

    assert content(given) == content(made) and robot.notes == ()


@pytest.mark.parametrize(
    ("inertial", "note"),
    [
        (
            '<mass value="0.6"/><inertia ixx="1" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>',
            "an inertia that no body has",
        ),
        (
            '<mass value="0.6"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="3"/>',
            "an inertia that no body has",
        ),
        ('<mass value="0.6"/>', "an inertia that no body has"),
        ('<mass value="0"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>', "no mass, 1000 kg/m3 of its"),
    ],
)
def test_inertias_that_no_body_has_come_from_the_shapes(tmp_path: Path, inertial: str, note: str) -> None:
    robot = read(tmp_path, JAW[0], link("left", f"<inertial>{inertial}</inertial>{BOX}"), JAW[3])
    (told,) = robot.notes
    assert told.startswith(f"hand.urdf: left: {note}")
    made = ElementTree.fromstring(robot.xml).find("link[@name='left']/inertial")
    assert made is not None
    mass = float(made.find("mass").get("value"))  # type: ignore[union-attr, arg-type]
    inertia = {key: float(value) for key, value in made.find("inertia").attrib.items()}  # type: ignore[union-attr]
    assert mass == pytest.approx(0.6 if "0.6" in inertial else 1000 * 0.02 * 0.04 * 0.06)
    assert inertia["ixx"] == pytest.approx(mass * (0.04**2 + 0.06**2) / 12)
    assert inertia["izz"] == pytest.approx(mass * (0.02**2 + 0.04**2) / 12) and abs(inertia["ixy"]) < 1e-12


def test_two_shapes_are_taken_together(tmp_path: Path) -> None:
    two = "".join(BOX.replace("<geometry>", f'<origin xyz="{x} 0 0"/><geometry>') for x in (-0.01, 0.05))
    robot = read(tmp_path, JAW[0], link("left", two), JAW[3])
    made = ElementTree.fromstring(robot.xml).find("link[@name='left']/inertial")
    assert made is not None and made.find("origin").get("xyz").split()[0] == "0.02"  # type: ignore[union-attr]
    mass, box = 0.096, 0.048 * (0.02**2 + 0.04**2) / 12
    izz = float(made.find("inertia").get("izz"))  # type: ignore[union-attr, arg-type]
    assert izz == pytest.approx(2 * box + mass * 0.03**2)


def test_a_moving_link_without_mass_and_shapes_is_light(tmp_path: Path) -> None:
    robot = read(
        tmp_path, JAW[0], link("spread", ""), JAW[1], joint("s", "palm", "spread"), joint("a", "spread", "left")
    )
    assert robot.notes == ("hand.urdf: spread: no mass, 1 g assumed",)
    assert '<mass value="0.001" />' in robot.xml
    frame = read(tmp_path, JAW[0], link("tcp", ""), joint("t", "palm", "tcp", kind="fixed"))
    assert frame.notes == () and frame.xml.count("inertial") == 2  # the palm's: a frame needs none


@pytest.mark.parametrize(
    ("inside", "message"),
    [
        ('<limit effort="1" velocity="1"/>', "joint a: expected <limit> with lower and upper"),
        ('<limit lower="0.4" upper="0.1"/>', "joint a: expected a lower limit below the upper one, got 0.4 and 0.1"),
        ('<limit lower="nan" upper="1"/>', "joint a: lower: expected a finite number, got nan"),
        ('<axis xyz="0 0 0"/>', "joint a: expected an axis of some length"),
        ('<axis xyz="0 1"/>', "joint a: axis: expected 3 finite numbers, got 0 1"),
        ('<origin xyz="0 0 up"/>', "joint a: origin: expected 3 finite numbers, got 0 0 up"),
        ('<mimic joint="z"/>', "joint a: expected <mimic> of a joint, got z, which the hand lacks"),
        ('<mimic joint="a"/>', "expected joints that follow others, got a circle: a"),
    ],
)
def test_joints_that_no_hand_can_have_are_refused(tmp_path: Path, inside: str, message: str) -> None:
    refused(tmp_path, message, link("palm"), link("left"), joint("a", "palm", "left", inside))


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (joint("a", "palm", "left", kind="floating"), "joint a: expected a type of revolute, .*; got floating"),
        (joint("a", "palm", "thumb"), "joint a: expected a link of the file, got thumb"),
        ('<joint name="a" type="fixed"><child link="left"/></joint>', "joint a: expected a parent link, got none"),
        (joint("a", "palm", "left") + joint("b", "palm", "left"), "expected one joint to hold left, got a, b"),
        (joint("a", "palm", "left") * 2, "expected a name of its own for every joint, got a"),
        (joint("a", "palm", "left") + link("left"), "expected a name of its own for every link, got left"),
        ("", "expected one link that all others hang from, got palm, left"),
    ],
)
def test_trees_that_no_hand_can_have_are_refused(tmp_path: Path, parts: str, message: str) -> None:
    refused(tmp_path, message, link("palm"), link("left"), parts)


def test_a_mass_that_is_no_number_is_refused(tmp_path: Path) -> None:
    odd = link("left", '<inertial><mass value="x"/></inertial>')
    refused(tmp_path, "link left: inertial: mass: expected a finite number, got x", JAW[0], odd, JAW[3])


def test_links_in_a_circle_are_refused(tmp_path: Path) -> None:
    circle = (link("x"), link("y"), joint("c", "x", "y"), joint("d", "y", "x"))
    refused(tmp_path, "expected one link that all others hang from, got palm$", *JAW, *circle)
    refused(tmp_path, "got a circle", *circle)


def test_a_joint_may_follow_one_that_follows(tmp_path: Path) -> None:
    robot = read(tmp_path, *JAW[:3], joint("a", "palm", "left", '<mimic joint="b"/>'), joint("b", "palm", "right"))
    assert robot.joint("a").mimic == Follow("b", 1.0, 0.0)
    refused(tmp_path, "got j, which does not move", *JAW[:3], joint("a", "palm", "left", '<mimic joint="j"/>'),
            joint("j", "palm", "right", kind="fixed"))  # fmt: skip


def test_files_that_are_no_urdf_say_what_they_are(tmp_path: Path) -> None:
    file = tmp_path / "hand.xml"
    for content, message in (
        ('<mujoco model="m"/>', "expected a URDF of a hand, got an MJCF file of MuJoCo"),
        ("<sdf/>", "got an SDF file of Gazebo"),
        ("<svg/>", "got a file of <svg>"),
        ("<robot name='r'/>", "got a <robot> without links"),
        ("<!DOCTYPE r><robot/>", "got a document type"),
        ("solid x", "expected a URDF of a hand, got"),
    ):
        file.write_text(content)
        with pytest.raises(InputError, match=re.escape(message)):
            read_robot(HandConfig(name="x", urdf=str(file)))
    with pytest.raises(InputError, match=r"^hand.urdf: expected a URDF file, got nowhere.urdf$"):
        read_robot(HandConfig(name="x", urdf="nowhere.urdf"))
