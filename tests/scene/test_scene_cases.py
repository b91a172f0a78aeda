"""The small inputs of ../shared/cases as scenes: each right, right with a line, or refused with the remedy.

Right is: normals that face the camera that saw the points, and a table where it is.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from spgf_torch.errors import InputError
from spgf_torch.scene.assembly import read_scene
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.scene import Scene
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings

CASES = Path(__file__).parents[3] / "shared" / "cases"
pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason="the cases are not here")
SENSING = settings(SensingConfig)
# Where the cameras of the cases are: in their own frame, in the world, in a robot's frame (the README's, and moved).
OWN, WORLD = (0.0, 0.0, 0.0), (0.25, -0.45, 0.45)
FILES = ("intrinsics", "poses", "mask", "segments")
ORIGIN = "taken for the origin, as in a camera's frame"
POSED = {"intrinsics": "K.txt", "poses": "pose_cam_to_world.txt", "table": "find"}
LEVEL = (0.0, 0.0, 1.0, 0.0)

# input, settings -> where it was seen from, a line that must be told ("" for none in particular)
RIGHT: list[tuple[str, dict, tuple[float, float, float], str]] = [
    ("arr0.npz", {}, OWN, r"pixels' rays meet at \(-?0\.000, -?0\.000, -?0\.000\)"),
    ("xyz_key.npz", {}, OWN, "pixels' rays meet"),
    ("points_hw4.npz", {}, OWN, "column 4"),
    ("camera_frame_scene.pcd", {"table": "find"}, OWN, ORIGIN),
    ("double_bigendian.ply", {"table": "find"}, OWN, ORIGIN),
    ("dup_x2.npy", {"table": "find"}, OWN, ORIGIN),
    ("n4_homog.npy", {}, OWN, "column 4, which is 1"),
    ("nan_unorganised.pcd", {}, OWN, "60 of 6000 points without a reading"),
    ("nan_normals_unorganised.pcd", {}, OWN, "60 of 6000 points"),
    ("pcd_crlf.pcd", {}, OWN, ORIGIN),
    ("pcd_crlf_binary.pcd", {}, OWN, ORIGIN),
    ("pcd_lower.pcd", {}, OWN, ORIGIN),
    ("pcd_minus_nan.pcd", {}, OWN, "100 of 4000 points"),
    ("pcd_nan_ind.pcd", {}, OWN, "100 of 4000 points"),
    ("pcd_qnan.pcd", {}, OWN, "100 of 4000 points"),
    ("pcd_nx.pcd", {}, OWN, ""),
    ("pcd_org_nan_normals.pcd", {}, OWN, "these points left out"),
    ("pcd_org_z10.pcd", {}, OWN, ""),
    ("pcd_upper_fields.pcd", {}, OWN, ORIGIN),
    ("photoneo_zeros.ply", {"table": "find"}, OWN, "4000 of 12218 points"),
    ("plain.ply", {"table": "find"}, OWN, ORIGIN),
    ("ply_3dgs.ply", {}, OWN, "estimated instead"),
    ("ply_camera_element.ply", {}, OWN, ""),
    ("ply_crlf.ply", {}, OWN, ""),
    ("ply_range_grid.ply", {}, OWN, ""),
    ("ply_rs_linebreaks.ply", {}, OWN, ORIGIN),
    ("ply_types_alias.ply", {}, OWN, ""),
    ("ply_upper.ply", {}, OWN, ""),
    ("ply_vertex_list.ply", {}, OWN, ""),
    ("realsense_grid_faces.ply", {}, OWN, "taken for the cloud of one view.*origin; as=mesh"),
    ("ros_structured.npy", {}, OWN, ORIGIN),
    ("zero_normals.pcd", {}, OWN, "estimated instead"),
    ("robot_frame_object.pcd", {}, (0.8, -0.3, 0.45), "evidently seen from"),
    ("robot_frame_object_0.6_-0.2_-0.05.pcd", {}, (0.85, -0.65, 0.4), "evidently seen from"),
    ("robot_frame_scene.pcd", {"table": "find"}, (0.8, -0.3, 0.45), "side of what stands on its largest plane"),
    ("robot_frame_scene_base_below.pcd", {"table": "find"}, (0.8, -0.3, 1.15), "side of what stands on"),
    ("world_zeros.ply", {"table": "find"}, (0.8, -0.3, 0.75), "side of what stands on"),
    ("cgn_style.npz", {"table": "find"}, OWN, "segmap beside the depth not used"),
    ("depth_mm.png", POSED, WORLD, r"tilted 0\.\d deg"),
    ("depth_mm.tiff", POSED, WORLD, r"depth: median 0\.615 m"),
    ("depth_f2.npy", POSED, WORLD, ""),
    ("depth_hw1.npy", POSED, WORLD, ""),
    ("depth240.png", {"intrinsics": "K240.txt"}, OWN, ""),
    ("depth_inf.npy", {"intrinsics": "K240.txt"}, OWN, ""),
    ("vga_mm.png", POSED | {"intrinsics": "K640.txt"}, WORLD, ""),
    ("vga_mm.png", POSED | {"intrinsics": "K640.txt", "mask": "vga_mask.png"}, WORLD, ""),
    ("vga_tum5000.png", POSED | {"intrinsics": "bop_camera640.json"}, WORLD, "depth_scale 0.2 read as mm per count"),
    ("depth_10000.png", POSED | {"intrinsics": "bop_camera.json"}, WORLD, "depth_scale 0.1 read as mm per count"),
    ("depth_mm.png", POSED | {"intrinsics": "ci_K_ne_P.yaml"}, WORLD, "P taken"),
    ("depth_mm.png", POSED | {"intrinsics": "ci_K_zero_P_ok.yaml"}, WORLD, "K is 0 or missing"),
    ("depth_mm.png", POSED | {"intrinsics": "ci_binning.yaml"}, WORLD, "brought to 320 x 240"),
    ("depth_mm.png", POSED | {"intrinsics": "ci_echo.txt"}, WORLD, ""),
    ("depth_mm.png", POSED | {"intrinsics": "ci_echo.yaml"}, WORLD, ""),
    ("depth_mm.png", POSED | {"intrinsics": "ci_plain.yaml"}, WORLD, ""),
    ("depth_mm.png", POSED | {"intrinsics": "dexnet.intr"}, WORLD, ""),
    ("depth_mm.png", POSED | {"intrinsics": "open3d_intrinsic.json"}, WORLD, ""),
    ("depth_mm.png", POSED | {"intrinsics": "open3d_traj_cam.json"}, WORLD, "extrinsic beside K is not used"),
    ("depth_mm.png", POSED | {"mask": "mask.png"}, WORLD, ""),
    ("depth_mm.png", POSED | {"mask": "mask_alpha_only.png"}, WORLD, ""),
    ("depth_mm.png", POSED | {"mask": "mask_1hw.npy"}, WORLD, ""),
    ("depth_mm.png", {"intrinsics": "K.txt", "mask": "mask.png"}, OWN, "no table: none given"),
    ("depth_mm.png", POSED | {"poses": "pose_3x4.txt"}, WORLD, ""),
    ("depth_mm.png", POSED | {"poses": "pose_tum.txt"}, WORLD, "TUM"),
]

# What cannot be known to be wrong of one image, but looks so: a warning.
WARNED: list[tuple[str, dict, str]] = [
    ("depth_mm.png", POSED | {"poses": "pose_opengl.txt"}, "warning: poses: z and the pictures' up are 174 deg apart"),
    ("depth_mm.png", POSED | {"poses": "pose_world_to_cam.txt"}, "warning: poses: z and the pictures' up are"),
    ("depth_mm.png", {"intrinsics": "K.txt", "mask": "mask_inverted.png"}, "inverted?"),
]

REFUSED: list[tuple[str, dict, str]] = [
    ("XYZ_units.csv", {}, "give a larger normal_radius"),
    ("all_duplicates.npy", {}, "all points lie in one place"),
    ("cloud.pts", {}, "give a larger normal_radius"),
    ("paraview.csv", {}, "give a larger normal_radius"),
    ("semicolon_decimal_comma.csv", {}, "give a larger normal_radius"),
    ("dup_x20.npy", {}, r"larger normal_radius, and normals or viewpoints=\[\[x,y,z\],...\]"),
    ("xyzrgb01.xyz", {}, r"give viewpoints=\[\[x,y,z\],...\]"),
    ("three_by_n.npy", {}, "transpose it"),
    ("utm.xyz", {}, "subtract an offset"),
    ("pcd_more_rows.pcd", {}, "expected 3990 rows"),
    ("pcd_no_width.pcd", {}, "SIZE: expected 3 values"),
    ("pcd_viewpoint6.pcd", {}, "VIEWPOINT: expected 7 values"),
    ("depth_8bit.png", {"intrinsics": "K.txt"}, "16-bit PNG"),
    ("depth_rgb_packed.png", {"intrinsics": "K.txt"}, "unpack"),
    ("depth_neg.npy", {"intrinsics": "K240.txt"}, "change the sign"),
    ("depth_mm.png", {"intrinsics": "K640.txt"}, "principal point"),
    ("depth_mm.png", {}, "intrinsics: expected the file of K"),
    ("depth_mm.png", POSED | {"mask": "mask_inverted.png"}, "above the plane, got none"),
]

# The unit is another: told in a warning, or refused, in any case with depth_scale.
SCALED: list[tuple[str, dict]] = [
    ("vga_tum5000.png", POSED | {"intrinsics": "K640.txt"}),
    ("vga_10000.png", POSED | {"intrinsics": "K640.txt"}),
    ("depth_tum5000.png", POSED),
    ("depth_10000.png", POSED),
]


def read(name: str, given: dict) -> Scene:
    paths = {key: str(CASES / value) if key in FILES else value for key, value in given.items()}
    config = settings(SceneConfig, input=str(CASES / name), **paths)
    return read_scene(config, SENSING, np.random.default_rng(0))


def case(values: tuple) -> str:
    return " ".join([values[0], *(f"{key}={value}" for key, value in values[1].items() if key != "poses")])


@pytest.mark.parametrize("values", RIGHT, ids=case)
def test_right(values: tuple[str, dict, tuple[float, float, float], str]) -> None:
    name, given, eye, line = values
    scene = read(name, given)
    assert len(scene.texlets) > 100 and scene.no_grasp is None
    towards = eye - scene.texlets.positions.double().numpy()
    facing = (scene.texlets.normals.double().numpy() * towards).sum(axis=1) > 0
    assert facing.mean() > 0.97
    assert not any(note.startswith("warning") and "behind" not in note for note in scene.notes), scene.notes
    assert any(re.search(line, note) for note in scene.notes), scene.notes
    if given.get("table") == "find":
        assert scene.table is not None
        assert np.linalg.norm(scene.table[:3]) == pytest.approx(1)
        assert scene.table[:3] @ eye + scene.table[3] == pytest.approx(0.45, abs=0.01)  # all cameras are as high
        if eye == WORLD:
            np.testing.assert_allclose(scene.table, LEVEL, atol=0.01)


@pytest.mark.parametrize("values", WARNED, ids=case)
def test_warned(values: tuple[str, dict, str]) -> None:
    assert any(values[2] in note for note in read(*values[:2]).notes)


@pytest.mark.parametrize("values", REFUSED, ids=case)
def test_refused(values: tuple[str, dict, str]) -> None:
    with pytest.raises(InputError, match=values[2]) as caught:
        read(*values[:2])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("values", SCALED, ids=case)
def test_another_depth_scale(values: tuple[str, dict]) -> None:
    try:
        told = [note for note in read(*values).notes if note.startswith("warning")]
    except InputError as error:
        told = [str(error)]
    assert any("depth_scale" in line for line in told)


@pytest.mark.parametrize("name", ["robot_frame_object.pcd", "robot_frame_object_0.6_-0.2_-0.05.pcd"])
def test_the_origin_given_for_a_cloud_in_a_robots_frame_is_refused(name: str) -> None:
    with pytest.raises(
        InputError, match=r"on the side that was seen, got \(0, 0, 0\) m, .* evidently seen from direction"
    ):
        read(name, {"viewpoints": [0, 0, 0]})


def test_points_on_a_line_give_no_grasp() -> None:
    scene = read("scan_line.xyz", {})
    assert scene.no_grasp is not None and "line" in scene.no_grasp and not len(scene.texlets)


@pytest.mark.parametrize("name", ["nan_unorganised_ascii.pcd", "cc_header_xyzrgb.txt"])
def test_a_sparse_cloud_of_which_a_plane_is_left_gives_no_grasp(name: str) -> None:
    scene = read(name, {})
    assert scene.no_grasp is not None and "one plane" in scene.no_grasp


def test_a_mesh_with_texture_by_face() -> None:
    scene = read("wedge_texcoord_box.ply", {})
    assert len(scene.texlets) > 300 and any("taken for a mesh (as=cloud" in note for note in scene.notes)


def test_the_big_box_does_not_hide_the_table() -> None:
    """Its top holds four times as many points as the table, 78 mm below, on which two more things stand."""
    scene = read("big_box_hides_table.png", {"intrinsics": "K240.txt", "table": "find"})
    assert scene.table is not None
    np.testing.assert_allclose(scene.table, [0, -0.1644, -0.9864, 0.6], atol=0.003)
    height = scene.texlets.positions.double().numpy() @ scene.table[:3] + scene.table[3]
    for low, high in ((0.05, 0.065), (0.075, 0.085), (0.14, 0.155)):
        assert ((height > low) & (height < high)).sum() > 20


def test_every_case_is_looked_at() -> None:
    told = Path(__file__).read_text() + (Path(__file__).parent / "test_cases.py").read_text()
    assert not [path.name for path in CASES.iterdir() if path.name not in told and path.name != "README.md"]
