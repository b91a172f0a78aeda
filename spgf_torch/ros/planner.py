"""Grasps for one message of a camera: what the node does, without ROS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from spgf_torch.ros.cameras import read_camera, read_depth
from spgf_torch.ros.clouds import read_cloud
from spgf_torch.ros.grasps import grasp_messages
from spgf_torch.ros.messages import Header
from spgf_torch.scene.scene import Scene

if TYPE_CHECKING:
    from spgf_torch.grasps.grasps import Grasps
    from spgf_torch.predictor import Predictor

# How REP 103 has the frames of cameras called, whose origin is where they see from.
_OPTICAL = ("_optical_frame", "_optical")


@dataclass(frozen=True)
class Plan:
    """What was found in one message.

    Attributes:
        grasps: best first, in the frame of the message. messages: a moveit_msgs/Grasp each, as dictionaries.
        header: the message's. notes: what was assumed, left out or looks wrong, and why there is no grasp: a line each.
    """

    grasps: Grasps
    messages: list[dict[str, Any]]
    header: Header
    notes: tuple[str, ...]


@dataclass(frozen=True)
class GraspPlanner:
    """Plans grasps with a model for what a camera's messages show.

    Attributes:
        top: grasps of each type. table: `find`, or None for none.
        viewpoint: (3,) m, where a cloud was seen from, in its frame; None: its origin where the frame is called an
            optical one, else what the points tell.
        T_base_parent: (4, 4) as for `grasps.grasp_message`.
    """

    model: Predictor
    top: int = 10
    table: str | None = "find"
    viewpoint: tuple[float, float, float] | None = None
    T_base_parent: np.ndarray | None = None

    def of_cloud(self, message: Any) -> Plan:
        """Grasps on what a PointCloud2 shows. Raises InputError in one line for a cloud that cannot be used."""
        cloud = read_cloud(message)
        eye = self.viewpoint
        if eye is None and cloud.header.frame.endswith(_OPTICAL):
            eye = (0.0, 0.0, 0.0)
        scene = Scene.from_points(cloud.points, eye, cloud.normals, sensing=self.model.sensing, table=self.table)
        return self._plan(scene, cloud.header)

    def of_depth(self, image: Any, camera: Any) -> Plan:
        """Grasps on what a depth Image and its CameraInfo show, in the camera's frame. Raises InputError likewise."""
        depth = read_depth(image)
        known = read_camera(camera, depth.shape[1], depth.shape[0])
        scene = Scene.from_depth(depth, known.K, sensing=self.model.sensing, table=self.table)
        return self._plan(scene, Header.of(image, "Image"), known.notes)

    def _plan(self, scene: Scene, header: Header, notes: tuple[str, ...] = ()) -> Plan:
        grasps = self.model.predict(scene, self.top)
        up = None if scene.table is None else scene.table[:3].tolist()
        how = {"T_base_parent": self.T_base_parent, "up": up}
        messages = grasp_messages(grasps, self.model.grippers, header, **how)
        why = () if grasps else (f"no grasp: {scene.no_grasp or 'none that the open hand could reach freely'}",)
        return Plan(grasps, messages, header, (*notes, *scene.notes, *why))
