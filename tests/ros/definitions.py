"""Message definitions of ROS 2, fields and types, and a check of dictionaries against them.

Each was compared with its source, and none differed.
- github.com/ros2/common_interfaces: CameraInfo at commit 27b84d3, Image 22012ae, PointField e05fcce, PointCloud2
  202d9d8, JointTrajectory ba32be2, JointTrajectoryPoint 14c2783, Vector3 and Vector3Stamped 14dded9, PoseArray and
  PoseStamped b94a858 (in geometry_interfaces, their package before).
- github.com/ros2/rcl_interfaces: Time and Duration at commit 401fd11.
- github.com/moveit/moveit_msgs: Grasp at commit 28ec33e; GraspPlanning b5c61b7 and MoveItErrorCodes 1b6ec53, with which
  `node` answers.
- The documentation made from the packages: Header and Quaternion of foxy and galactic (docs.ros2.org),
  GripperTranslation of jazzy (docs.ros.org), Point and RegionOfInterest (docs.clearpathrobotics.com, January 2026).
- github.com/ros/common_msgs, which is ROS 1's: Pose at commit d4c69ab.
"""

from __future__ import annotations

from typing import Any

DEFINITIONS = {
    "builtin_interfaces/Time": "int32 sec; uint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec; uint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp; string frame_id",
    "geometry_msgs/Point": "float64 x; float64 y; float64 z",
    "geometry_msgs/Vector3": "float64 x; float64 y; float64 z",
    "geometry_msgs/Quaternion": "float64 x; float64 y; float64 z; float64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position; geometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseStamped": "std_msgs/Header header; geometry_msgs/Pose pose",
    "geometry_msgs/Vector3Stamped": "std_msgs/Header header; geometry_msgs/Vector3 vector",
    "geometry_msgs/PoseArray": "std_msgs/Header header; geometry_msgs/Pose[] poses",
    "sensor_msgs/PointField": "string name; uint32 offset; uint8 datatype; uint32 count",
    "sensor_msgs/PointCloud2": "std_msgs/Header header; uint32 height; uint32 width; sensor_msgs/PointField[] fields; "
    "bool is_bigendian; uint32 point_step; uint32 row_step; uint8[] data; bool is_dense",
    "sensor_msgs/Image": "std_msgs/Header header; uint32 height; uint32 width; string encoding; uint8 is_bigendian; "
    "uint32 step; uint8[] data",
    "sensor_msgs/RegionOfInterest": "uint32 x_offset; uint32 y_offset; uint32 height; uint32 width; bool do_rectify",
    "sensor_msgs/CameraInfo": "std_msgs/Header header; uint32 height; uint32 width; string distortion_model; "
    "float64[] d; float64[9] k; float64[9] r; float64[12] p; uint32 binning_x; uint32 binning_y; "
    "sensor_msgs/RegionOfInterest roi",
    "trajectory_msgs/JointTrajectoryPoint": "float64[] positions; float64[] velocities; float64[] accelerations; "
    "float64[] effort; builtin_interfaces/Duration time_from_start",
    "trajectory_msgs/JointTrajectory": "std_msgs/Header header; string[] joint_names; "
    "trajectory_msgs/JointTrajectoryPoint[] points",
    "moveit_msgs/GripperTranslation": "geometry_msgs/Vector3Stamped direction; float32 desired_distance; "
    "float32 min_distance",
    "moveit_msgs/Grasp": "string id; trajectory_msgs/JointTrajectory pre_grasp_posture; "
    "trajectory_msgs/JointTrajectory grasp_posture; geometry_msgs/PoseStamped grasp_pose; float64 grasp_quality; "
    "moveit_msgs/GripperTranslation pre_grasp_approach; moveit_msgs/GripperTranslation post_grasp_retreat; "
    "moveit_msgs/GripperTranslation post_place_retreat; float32 max_contact_force; string[] allowed_touch_objects",
}
SIMPLE = {"string": str, "bool": bool, "float32": float, "float64": float}


def differences(values: Any, kind: str, where: str = "") -> list[str]:
    """What of `values` is not as the definition `kind` has it; nothing of a message that rclpy would take."""
    if kind.endswith("]"):
        inner, _, length = kind[:-1].partition("[")
        if inner == "uint8" and isinstance(values, bytes):
            return []
        if not isinstance(values, list) or (length and len(values) != int(length)):
            return [f"{where}: {type(values).__name__} for {kind}"]
        return [line for i, each in enumerate(values) for line in differences(each, inner, f"{where}[{i}]")]
    if kind in DEFINITIONS:
        fields = dict(reversed(field.split()) for field in DEFINITIONS[kind].split("; "))
        if not isinstance(values, dict) or values.keys() != fields.keys():
            return [f"{where}: {sorted(values)} for {sorted(fields)}"]
        return [line for name, inner in fields.items() for line in differences(values[name], inner, f"{where}.{name}")]
    if kind in SIMPLE:
        return [] if type(values) is SIMPLE[kind] else [f"{where}: {values!r} for {kind}"]
    unsigned, bits = kind.startswith("u"), int(kind.lstrip("uint"))
    low, high = (0, 2**bits) if unsigned else (-(2 ** (bits - 1)), 2 ** (bits - 1))
    return [] if type(values) is int and low <= values < high else [f"{where}: {values!r} for {kind}"]
