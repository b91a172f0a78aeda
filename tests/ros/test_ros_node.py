"""The planner on clouds and depth images of a box on a table, and the node's wiring with a tiny stand-in for rclpy."""

import sys
from functools import partial
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from commands import ROOT, python
from definitions import differences

import spgf_torch
from spgf_torch.errors import InputError
from spgf_torch.ros.cameras import camera_message, image_message
from spgf_torch.ros.clouds import cloud_message
from spgf_torch.ros.grasps import read_grasp
from spgf_torch.ros.messages import Header
from spgf_torch.ros.node import FAILURE, NO_DATA, SUCCESS, GraspNode, check_ros
from spgf_torch.ros.planner import GraspPlanner
from spgf_torch.sensing.cameras import Camera, cast, look_at

HEADER = Header("camera_optical_frame", 5)


@pytest.fixture(scope="module")
def planner() -> GraspPlanner:
    return GraspPlanner(spgf_torch.load(ROOT / "data/models/panda"), top=3)


@pytest.fixture(scope="module")
def seen() -> tuple[np.ndarray, Camera]:
    """Depth (H, W) of a box 40 x 60 x 80 mm on a table, from 0.5 m away, 40 deg up."""
    box = trimesh.creation.box((0.04, 0.06, 0.08)).apply_translation((0, 0, 0.04))
    table = trimesh.creation.box((0.8, 0.8, 0.02)).apply_translation((0, 0, -0.01))
    K = np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]])
    T = look_at(np.array([0.38, 0.1, 0.36]), np.array([0, 0, 0.03]))
    camera = Camera(K, T, 320, 240)
    return cast(trimesh.util.concatenate([box, table]), camera)[0], camera


def points_of(seen: tuple[np.ndarray, Camera]) -> np.ndarray:
    depth, camera = seen
    return np.where(depth[..., None] > 0, camera.rays() * depth[..., None], np.nan)


def test_a_cloud_and_its_depth_image_give_the_same_kind_of_grasps(
    planner: GraspPlanner, seen: tuple[np.ndarray, Camera]
) -> None:
    depth, camera = seen
    of_cloud = planner.of_cloud(cloud_message(points_of(seen), HEADER))
    image = image_message(np.round(1000 * depth).astype(np.uint16), HEADER)
    of_depth = planner.of_depth(image, camera_message(camera.K, 320, 240, HEADER))
    up = camera.T_object_camera[2, :3]  # z of the table in the camera's frame
    for plan in (of_cloud, of_depth):
        assert plan.messages and plan.header == HEADER and len(plan.messages) == len(plan.grasps)
        assert not [line for values in plan.messages for line in differences(values, "moveit_msgs/Grasp")]
        best = read_grasp(plan.messages[0])
        place = (camera.T_object_camera @ plan.grasps[0].T_input_tcp)[:3, 3]
        assert np.abs(place[:2]).max() < 0.06 and 0 < place[2] < 0.1
        assert best.quality == plan.grasps[0].probability and set(best.opened) <= set(plan.grasps[0].joints)
        lift = plan.messages[0]["post_grasp_retreat"]["direction"]["vector"]
        np.testing.assert_allclose(list(lift.values()), up, atol=0.05)


def test_nothing_to_see_is_refused(planner: GraspPlanner) -> None:
    with pytest.raises(InputError):
        planner.of_cloud(cloud_message(np.zeros((0, 3)), HEADER))


class FakeNode:
    """What the node uses of rclpy.node.Node."""

    def __init__(self) -> None:
        self.values: dict[str, Any] = {}
        self.topics: dict[str, Any] = {}
        self.published: list[Any] = []
        self.said: list[tuple[str, str]] = []

    def declare_parameter(self, name: str, default: Any) -> None:
        self.values.setdefault(name, default)

    def get_parameter(self, name: str) -> Any:
        return SimpleNamespace(value=self.values[name])

    def create_subscription(self, kind: type, topic: str, callback: Any, qos: Any) -> None:
        assert qos == "sensor data" and kind.__name__ == {"points": "PointCloud2", "depth": "Image"}.get(
            topic, "CameraInfo"
        )
        self.topics[topic] = callback

    def create_service(self, kind: type, name: str, callback: Any) -> None:
        assert (kind.__name__, name) == ("GraspPlanning", "~/plan_grasps")
        self.ask = partial(callback, SimpleNamespace())

    def create_publisher(self, kind: type, topic: str, depth: int) -> Any:
        assert (kind.__name__, topic) == ("PoseArray", "~/grasp_poses")
        return SimpleNamespace(publish=self.published.append)

    def get_logger(self) -> Any:
        return SimpleNamespace(
            **{level: lambda words, level=level: self.said.append((level, words)) for level in LEVELS}
        )


LEVELS = ("info", "error")


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> None:
    """Modules of ROS with empty messages, whose fields are set as they are given."""
    names = {
        "sensor_msgs.msg": ("PointCloud2", "Image", "CameraInfo"),
        "geometry_msgs.msg": ("PoseArray",),
        "moveit_msgs.msg": ("Grasp",),
        "moveit_msgs.srv": ("GraspPlanning",),
    }
    modules = {name: {kind: type(kind, (), {}) for kind in kinds} for name, kinds in names.items()}
    modules |= {name.split(".")[0]: {} for name in names}
    modules |= {"rclpy": {}, "rclpy.qos": {"qos_profile_sensor_data": "sensor data"}}
    modules["rosidl_runtime_py"] = {"set_message_fields": lambda message, values: message.__dict__.update(values)}
    for name, content in modules.items():
        monkeypatch.setitem(sys.modules, name, module := ModuleType(name))
        module.__dict__.update(content)


def answer() -> Any:
    return SimpleNamespace(grasps=[], error_code=SimpleNamespace(val=0))


def test_the_node_answers(ros: None, planner: GraspPlanner, seen: tuple[np.ndarray, Camera]) -> None:
    node = FakeNode()
    GraspNode(node, planner)
    first = node.ask(answer())
    assert first.error_code.val == NO_DATA and not first.grasps and node.said[0][0] == "error"
    node.topics["points"](cloud_message(np.zeros((0, 3)), HEADER))
    assert node.ask(answer()).error_code.val == FAILURE and not node.published
    node.topics["points"](cloud_message(points_of(seen), HEADER))
    got = node.ask(answer())
    assert got.error_code.val == SUCCESS and len(got.grasps) == len(node.published[0].poses) > 0
    assert read_grasp(got.grasps[0]).quality >= read_grasp(got.grasps[-1]).quality
    assert node.published[0].header["frame_id"] == "camera_optical_frame"


def test_depth_wants_its_camera(ros: None) -> None:
    node, asked = FakeNode(), []
    planner = SimpleNamespace(of_depth=lambda *given: asked.append(given) or SimpleNamespace(**EMPTY))
    GraspNode(node, planner)
    node.topics["depth"]("image")
    assert node.ask(answer()).error_code.val == FAILURE and "got depth" in node.said[-1][1]
    node.topics["camera_info"]("camera")
    assert node.ask(answer()).error_code.val == FAILURE  # no grasp is no success
    assert asked == [("image", "camera")] and node.said[-1] == ("info", "no grasp: nothing")


EMPTY: dict[str, Any] = {"grasps": [], "messages": [], "header": HEADER, "notes": ("no grasp: nothing",)}


def test_without_ros_the_node_says_what_is_missing() -> None:
    with pytest.raises(InputError, match="rclpy: expected a ROS 2 environment"):
        check_ros()
    done = python("-m", "spgf_torch.ros.node", cwd=ROOT)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "Traceback" not in done.stderr
