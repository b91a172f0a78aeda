"""ROS 2 and MoveIt: messages as plain dictionaries, to and from arrays and grasps, and a node that plans grasps.

`messages` reads fields of dictionaries and of rclpy's messages alike; `clouds` is sensor_msgs/PointCloud2, `cameras`
CameraInfo and Image, `grasps` moveit_msgs/Grasp and geometry_msgs/PoseArray. None of these needs ROS. `planner` turns
one message of a camera into grasps; `node` wraps it in rclpy, which it imports when it is started. The paper has no
part in this.

Dictionaries have the fields of the message, all of them, by their names; `rosidl_runtime_py.set_message_fields` fills a
message with one, `message_to_ordereddict` makes one of a message. ROS's quaternions are x y z w, its camera frames have
z ahead and y down (REP 103), its depths are m as floats and mm as whole numbers, NaN and 0 no reading (REP 118).
"""
