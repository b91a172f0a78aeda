"""The small inputs of ../shared/cases, read: each right, right with a line, or refused with the remedy."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spgf_torch.errors import InputError
from spgf_torch.files.mesh_files import mesh_arrays
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.depth_files import is_depth
from spgf_torch.scene.files import read_clouds
from spgf_torch.scene.intrinsics import read_intrinsics
from spgf_torch.scene.labels import read_mask
from spgf_torch.scene.poses import read_poses
from spgf_torch.scene.views import read_views
from spgf_torch.settings import settings

CASES = Path(__file__).parents[3] / "shared" / "cases"
pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason="the cases are not here")
LEFT_OUT = r"without a reading \(NaN, infinite or 0 0 0\) left out"
NORMALS = "normals NaN, infinite or of length 0 in {} of {} points: "

# name -> points kept, a line that is told ("" for none), with normals
CLOUDS: dict[str, tuple[int, str, bool]] = {
    "XYZ_units.csv": (4000, "", False),
    "arr0.npz": (4572, "array arr_0 taken for the points", False),
    "cc_header_xyzrgb.txt": (3000, "", False),
    "cloud.pts": (4000, "columns without names", False),
    "double_bigendian.ply": (8000, "", False),
    "n4_homog.npy": (6000, "column 4, which is 1 throughout, left out", False),
    "nan_normals_unorganised.pcd": (5940, NORMALS.format(60, 6000) + "these points left out", True),
    "nan_unorganised.pcd": (5940, f"60 of 6000 points {LEFT_OUT}", False),
    "nan_unorganised_ascii.pcd": (2970, f"30 of 3000 points {LEFT_OUT}", False),
    "paraview.csv": (4000, "", False),
    "pcd_crlf.pcd": (4000, "", False),
    "pcd_crlf_binary.pcd": (4000, "", False),
    "pcd_lower.pcd": (4000, "", False),
    "pcd_minus_nan.pcd": (3900, f"100 of 4000 points {LEFT_OUT}", False),
    "pcd_nan_ind.pcd": (3900, f"100 of 4000 points {LEFT_OUT}", False),
    "pcd_nx.pcd": (4000, "", True),
    "pcd_org_nan_normals.pcd": (3555, "these points left out", True),
    "pcd_qnan.pcd": (3900, f"100 of 4000 points {LEFT_OUT}", False),
    "pcd_upper_fields.pcd": (4000, "", False),
    "photoneo_zeros.ply": (8218, f"4000 of 12218 points {LEFT_OUT}", False),
    "plain.ply": (8218, "", False),
    "ply_3dgs.ply": (4000, NORMALS.format(4000, 4000) + "estimated instead", False),
    "ply_camera_element.ply": (4000, "", False),
    "ply_crlf.ply": (4000, "", False),
    "ply_range_grid.ply": (4000, "", False),
    "ply_rs_linebreaks.ply": (4000, "", False),
    "ply_types_alias.ply": (4000, "", False),
    "ply_upper.ply": (4000, "", False),
    "ply_vertex_list.ply": (4000, "", False),
    "points_hw4.npz": (10800, "column 4", False),
    "realsense_grid_faces.ply": (4572, "", False),
    "robot_frame_scene.pcd": (14000, "", False),
    "ros_structured.npy": (6000, "", False),
    "semicolon_decimal_comma.csv": (4000, "decimal commas read as points", False),
    "wedge_texcoord_box.ply": (8, "", False),
    "world_zeros.ply": (8218, f"4000 of 12218 points {LEFT_OUT}", False),
    "xyz_key.npz": (4572, "array xyz taken for the points", False),
    "xyzrgb01.xyz": (2500, "columns 4 to 6 taken for colours", False),
    "zero_normals.pcd": (6000, NORMALS.format(6000, 6000) + "estimated instead", False),
}


@pytest.mark.parametrize("name", CLOUDS)
def test_clouds(name: str) -> None:
    """The points as they lie in the scene of the cases, none at the origin; no viewpoint is invented."""
    count, note, normals = CLOUDS[name]
    config = settings(SceneConfig)
    assert not is_depth(CASES / name, config)
    (cloud,) = read_clouds([CASES / name], config)
    assert len(cloud) == count
    assert np.isfinite(cloud.points).all()
    assert np.abs(cloud.points).max() < 1.5
    assert np.ptp(cloud.points, axis=0).min() > 0.04  # no column taken for another
    assert cloud.viewpoints is None
    assert (cloud.normals is not None) == normals
    assert any(re.search(note, line) for line in cloud.notes) if note else cloud.notes == ()


# name -> intrinsics, median depth in m, a line that is told
DEPTHS: dict[str, tuple[str | None, float, str]] = {
    "depth_mm.png": ("K.txt", 0.615, ""),
    "depth_mm.tiff": ("K.txt", 0.615, ""),
    "depth240.png": ("K240.txt", 0.634, ""),
    "depth_f2.npy": ("K.txt", 0.615, ""),
    "depth_hw1.npy": ("K.txt", 0.615, ""),
    "depth_inf.npy": ("K240.txt", 0.634, ""),
    "depth_10000.png": ("bop_camera.json", 0.615, "depth_scale 0.1 read as mm per count"),
    "vga_tum5000.png": ("bop_camera640.json", 0.622, "depth_scale 0.2 read as mm per count"),
    "cgn_style.npz": (None, 0.615, "segmap beside the depth not used; segments="),
    "depth_mm.png ci_K_ne_P.yaml": ("ci_K_ne_P.yaml", 0.615, "P taken, which is of the rectified image"),
    "depth_mm.png ci_K_zero_P_ok.yaml": ("ci_K_zero_P_ok.yaml", 0.615, "K is 0 or missing"),
    "depth_mm.png ci_binning.yaml": ("ci_binning.yaml", 0.615, "brought to 320 x 240"),
}


@pytest.mark.parametrize("name", DEPTHS)
def test_depth_images(name: str) -> None:
    intrinsics, median, note = DEPTHS[name]
    path = CASES / name.split()[0]
    config = settings(SceneConfig, intrinsics=None if intrinsics is None else str(CASES / intrinsics))
    assert is_depth(path, config)
    (view,) = read_views([path], config)
    depth = view.depth[np.isfinite(view.depth) & (view.depth > 0)]
    assert np.median(depth) == pytest.approx(median, abs=0.002)
    assert view.camera.K[0, 0] in (300, 260, 600)
    assert any(note in line for line in view.notes) if note else view.notes == ()


@pytest.mark.parametrize(
    "name",
    ["K.txt", "bop_camera.json", "ci_echo.txt", "ci_echo.yaml", "ci_plain.yaml", "ci_K_ne_P.yaml",
     "ci_K_zero_P_ok.yaml", "dexnet.intr", "open3d_intrinsic.json", "open3d_traj_cam.json"],
)  # fmt: skip
def test_intrinsics(name: str) -> None:
    np.testing.assert_array_equal(read_intrinsics(CASES / name).K, np.loadtxt(CASES / "K.txt"))


@pytest.mark.parametrize("name", ["pose_cam_to_world.txt", "pose_3x4.txt", "pose_tum.txt"])
def test_poses(name: str) -> None:
    np.testing.assert_allclose(read_poses([CASES / name])[0], [np.loadtxt(CASES / "pose_cam_to_world.txt")], atol=1e-12)


@pytest.mark.parametrize("name", ["mask_alpha_only.png", "mask_1hw.npy"])
def test_masks(name: str) -> None:
    read = read_mask(CASES / name, 10**6)
    np.testing.assert_array_equal(read.reshape(240, 320), read_mask(CASES / "mask.png", 10**6))


def test_a_mask_that_marks_nearly_everything_is_told() -> None:
    given = {"intrinsics": "K.txt", "mask": "mask_inverted.png"}
    config = settings(SceneConfig, **{key: str(CASES / name) for key, name in given.items()})
    (view,) = read_views([CASES / "depth_mm.png"], config)
    assert any("marks 73997 of 76800 values as the target; inverted?" in note for note in view.notes)


def test_texture_by_face_leaves_the_vertices() -> None:
    assert [array.shape for array in mesh_arrays(CASES / "wedge_texcoord_box.ply")] == [(8, 3), (12, 3)]


def cloud(name: str) -> Callable[[], Any]:
    return lambda: read_clouds([CASES / name], settings(SceneConfig))


def view(name: str, intrinsics: str) -> Callable[[], Any]:
    return lambda: read_views([CASES / name], settings(SceneConfig, intrinsics=str(CASES / intrinsics)))


@pytest.mark.parametrize(
    ("read", "message"),
    [
        (cloud("three_by_n.npy"), r"expected shape \(N, 3\).*got \(3, 6000\); transpose it"),
        (cloud("pcd_more_rows.pcd"), "expected 3990 rows of 3 values"),
        (cloud("pcd_no_width.pcd"), "SIZE: expected 3 values in the PCD header"),
        (cloud("pcd_viewpoint6.pcd"), "VIEWPOINT: expected 7 values in the PCD header, got 6"),
        (
            view("depth_neg.npy", "K240.txt"),
            "got none of 43200; 4572 are negative: .* change the sign",
        ),
        (view("depth_8bit.png", "K240.txt"), "got 8 bits and 1 channels; .* 16-bit PNG"),
        (view("depth_rgb_packed.png", "K240.txt"), "got 8 bits and 3 channels; .*unpack"),
        (view("depth_mm.png", "K640.txt"), "principal point"),
        (
            view("depth_mm.png", "bop_camera640.json"),
            "K of an image of 320 x 240 pixels, got one of 640",
        ),
    ],
)
def test_refused_with_the_remedy(read: Callable[[], Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read()
    assert "\n" not in str(caught.value)
