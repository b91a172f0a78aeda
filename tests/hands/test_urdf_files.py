"""Where the files of a hand are looked for, and xacro."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from spgf_torch.errors import InputError
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.urdf import read_robot
from spgf_torch.hands.urdf_files import mesh_file

ROBOT = '<robot name="r"><link name="palm"><collision><geometry>{}</geometry></collision></link></robot>'


def put(path: Path, text: str = "solid x") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def test_paths_beside_the_urdf_above_it_and_absolute(tmp_path: Path) -> None:
    urdf, beside = tmp_path / "hand" / "urdf" / "h.urdf", put(tmp_path / "hand" / "urdf" / "m" / "a.stl")
    above, spaced = put(tmp_path / "hand" / "meshes" / "b.stl"), put(tmp_path / "my hand.stl")
    assert mesh_file("m/a.stl", urdf, {}) == beside
    assert mesh_file("../meshes/b.stl", urdf, {}).resolve() == above
    for name in (str(above), f"file://{above}", f"file:///{above}"):
        assert mesh_file(name, urdf, {}) == above
    assert mesh_file(f"file://{tmp_path}/my%20hand.stl", urdf, {}) == spaced
    with pytest.raises(InputError, match=r"h.urdf: expected the mesh m/b.stl, got no file .*/hand/urdf/m/b.stl$"):
        mesh_file("m/b.stl", urdf, {})
    with pytest.raises(
        InputError, match=r"expected the file of a mesh, package://NAME/FILE or .*; got http://x/a.stl$"
    ):
        mesh_file("http://x/a.stl", urdf, {})


def test_packages_in_their_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)
    urdf, name = tmp_path / "a" / "grip" / "urdf" / "h.urdf", "package://grip/m/x.stl"
    with pytest.raises(
        InputError, match=r"h.urdf: expected the file package://grip/m/x.stl, got none in ROS.*packages"
    ):
        mesh_file(name, urdf, {})
    beside = put(tmp_path / "packages" / "grip" / "m" / "x.stl")
    assert mesh_file(name, urdf, {}) == beside
    own = put(tmp_path / "a" / "grip" / "m" / "x.stl")  # the URDF stands in its package
    assert mesh_file(name, urdf, {}) == own
    ament = put(tmp_path / "ros2" / "share" / "grip" / "m" / "x.stl")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}/ros2")
    assert mesh_file(name, urdf, {}) == ament
    ros = put(tmp_path / "ws" / "repository" / "grip" / "m" / "x.stl")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ws"))
    assert mesh_file(name, urdf, {}) == ros
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ws" / "repository" / "grip"))
    assert mesh_file(name, urdf, {}) == ros
    told = put(tmp_path / "told" / "m" / "x.stl")
    assert mesh_file(name, urdf, {"grip": str(tmp_path / "told")}) == told
    with pytest.raises(InputError, match=r"expected m/y.stl in hand.packages.grip, got none in .*told$"):
        mesh_file("package://grip/m/y.stl", urdf, {"grip": str(tmp_path / "told")})
    with pytest.raises(InputError, match=r"expected package://NAME/FILE, got package://grip$"):
        mesh_file("package://grip", urdf, {})


def test_a_urdf_in_a_package(tmp_path: Path) -> None:
    put(tmp_path / "urdf" / "h.urdf", ROBOT.format('<sphere radius="0.02"/>'))
    config = HandConfig(name="r", urdf="package://grip/urdf/h.urdf", packages={"grip": str(tmp_path)})
    assert read_robot(config).path == tmp_path / "urdf" / "h.urdf"


XACRO = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{}</robot>'


def test_xacro_is_expanded_with_its_includes_and_default_arguments(tmp_path: Path) -> None:
    pytest.importorskip("xacrodoc")
    inner = (
        '<xacro:macro name="part" params="w"><link name="palm"><collision><geometry>'
        '<box size="${2*w} ${depth} 0.1"/></geometry></collision></link></xacro:macro>'
    )
    put(tmp_path / "grip" / "urdf" / "inner.xacro", XACRO.format(inner))
    put(tmp_path / "other" / "depth.xacro", XACRO.format('<xacro:property name="depth" value="0.03"/>'))
    whole = (
        '<xacro:arg name="w" default="0.02"/><xacro:include filename="inner.xacro"/>'
        '<xacro:include filename="$(find other)/depth.xacro"/><xacro:part w="$(arg w)"/>'
    )
    for name in ("h.urdf.xacro", "h.urdf"):  # whatever it is called
        file = put(tmp_path / "grip" / "urdf" / name, XACRO.format(whole))
        robot = read_robot(HandConfig(name="r", urdf=str(file)))
        assert '<box size="0.04 0.03 0.1" />' in robot.xml and robot.path == file
    (tmp_path / "other" / "depth.xacro").unlink()
    (tmp_path / "other").rmdir()
    with pytest.raises(InputError, match=r"h.urdf: expected the package other, got none in ROS_PACKAGE_PATH .*"):
        read_robot(HandConfig(name="r", urdf=str(file)))
    put(file, XACRO.format('<link name="${1/0}"/>' + whole))
    with pytest.raises(InputError, match=r"h.urdf: expected a xacro file of a hand, got .*division by zero"):
        read_robot(HandConfig(name="r", urdf=str(file)))


@pytest.mark.parametrize("package", ["xacrodoc", "collada"])
def test_what_the_extra_brings_is_named_where_it_lacks(
    tmp_path: Path, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setattr("spgf_torch.extras.find_spec", lambda name: None if name == package else name)
    put(tmp_path / "m.dae", "<COLLADA/>")
    file = put(tmp_path / ("h.xacro" if package == "xacrodoc" else "h.urdf"), ROBOT.format('<mesh filename="m.dae"/>'))
    with pytest.raises(InputError, match=rf"expected (py)?{package} \(pip install 'spgf-torch\[hands\]'\)"):
        read_robot(HandConfig(name="r", urdf=str(file)))
