"""`python -m spgf_torch.ros.node`: a ROS 2 node that plans grasps on the latest cloud, or depth image, when asked.

    points (sensor_msgs/PointCloud2), or depth (Image) and camera_info (CameraInfo): what is seen; the latest counts
    ~/plan_grasps (moveit_msgs/srv/GraspPlanning): grasps on it, best first, in its frame
    ~/grasp_poses (geometry_msgs/PoseArray): the TCPs of the grasps that were planned last, for RViz

Parameters: `model` (name or folder; required), `top` (grasps of each type), `table` (`find` or empty), `viewpoint`
(three numbers, m, in the frame of the cloud, or none). The request's fields are not used: all that is seen
may be grasped.

rclpy, rosidl_runtime_py and the messages come with ROS, not with pip; they are imported when the node is started.
"""

from __future__ import annotations

import importlib
import sys
from typing import Any

from spgf_torch.errors import InputError

# moveit_msgs/MoveItErrorCodes.
SUCCESS, FAILURE, NO_DATA = 1, 99999, -5
PARAMETERS = {"model": "", "top": 10, "table": "find"}
_NEEDED = ("rclpy", "rosidl_runtime_py", "sensor_msgs.msg", "geometry_msgs.msg", "moveit_msgs.srv")


class GraspNode:
    """Subscriptions, service and publisher of an rclpy node, and the latest messages."""

    def __init__(self, node: Any, planner: Any = None) -> None:
        """Declare the parameters and connect.

        Args:
            node: an rclpy.node.Node.
            planner: a `planner.GraspPlanner`; None: one of the node's parameters, whose model is loaded now.

        Raises InputError for a model that cannot be loaded.
        """
        from geometry_msgs.msg import PoseArray
        from moveit_msgs.srv import GraspPlanning
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import CameraInfo, Image, PointCloud2

        self.node, self.latest = node, dict[str, Any]()
        for name, default in PARAMETERS.items():
            node.declare_parameter(name, default)
        node.declare_parameter("viewpoint", [float("nan")] * 3)  # a list without numbers would have no type
        self.planner = planner or planner_of({name: self._parameter(name) for name in (*PARAMETERS, "viewpoint")})
        for topic, kind in (("points", PointCloud2), ("depth", Image), ("camera_info", CameraInfo)):
            node.create_subscription(kind, topic, self._keep(topic), qos_profile_sensor_data)
        self.poses, self.pose_array = node.create_publisher(PoseArray, "~/grasp_poses", 1), PoseArray
        node.create_service(GraspPlanning, "~/plan_grasps", self.plan)

    def plan(self, request: Any, response: Any) -> Any:
        """Answer a request for grasps on the latest messages; what cannot be used is logged and told by the code."""
        from moveit_msgs.msg import Grasp
        from rosidl_runtime_py import set_message_fields

        from spgf_torch.ros.grasps import pose_array

        try:
            plan = self._planned()
        except InputError as error:
            self.node.get_logger().error(str(error))
            response.error_code.val = FAILURE if self.latest else NO_DATA
            return response
        for note in plan.notes:
            self.node.get_logger().info(note)
        for values in plan.messages:
            set_message_fields(message := Grasp(), values)
            response.grasps.append(message)
        response.error_code.val = SUCCESS if plan.messages else FAILURE
        set_message_fields(shown := self.pose_array(), pose_array(plan.grasps, plan.header))
        self.poses.publish(shown)
        return response

    def _planned(self) -> Any:
        """The plan for a cloud, or else for a depth image. Raises InputError where nothing has come yet."""
        if "points" in self.latest:
            return self.planner.of_cloud(self.latest["points"])
        if "depth" in self.latest and "camera_info" in self.latest:
            return self.planner.of_depth(self.latest["depth"], self.latest["camera_info"])
        got = ", ".join(self.latest) or "nothing"
        raise InputError(f"plan_grasps: expected a message on points, or on depth and camera_info; got {got}")

    def _keep(self, topic: str) -> Any:
        def keep(message: Any) -> None:
            self.latest[topic] = message

        return keep

    def _parameter(self, name: str) -> Any:
        return self.node.get_parameter(name).value


def planner_of(parameters: dict[str, Any]) -> Any:
    """The planner that the node's parameters describe. Raises InputError for a model that cannot be loaded."""
    import math

    import spgf_torch
    from spgf_torch.ros.planner import GraspPlanner

    given = [float(value) for value in parameters["viewpoint"]]
    if len(given) != 3:
        raise InputError(f"viewpoint: expected three numbers in m, got {len(given)}")
    eye = None if any(map(math.isnan, given)) else (given[0], given[1], given[2])
    model = spgf_torch.load(parameters["model"]).ready()
    return GraspPlanner(model, parameters["top"], parameters["table"] or None, eye)


def check_ros() -> None:
    """InputError where ROS is not at hand, in one line that names what is missing."""
    for name in _NEEDED:
        try:
            importlib.import_module(name)
        except ImportError:
            raise InputError(
                f"{name}: expected a ROS 2 environment with moveit_msgs (source /opt/ros/DISTRIBUTION/setup.bash; "
                "packages ros-DISTRIBUTION-moveit-msgs, -rosidl-runtime-py), got no such package"
            ) from None


def main() -> None:
    """Start the node and serve until it is interrupted; status 2 and a line where it cannot be started."""
    try:
        check_ros()
        import rclpy

        rclpy.init()
        node = rclpy.create_node("spgf_grasps")
        GraspNode(node)
    except InputError as error:
        print(f"spgf_torch.ros.node: {error}", file=sys.stderr)
        sys.exit(2)
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
