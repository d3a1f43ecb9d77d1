"""Standard ROS 2 message types, for logs that name a type without defining it (rosbag2 before Iron)."""

from __future__ import annotations

from collections.abc import Mapping

_STAMPED = {"Wrench": "wrench", "Pose": "pose", "Twist": "twist", "Accel": "accel"}
_NUMBERS = ("Float64", "Float32", "Int64", "Int32", "Int16", "Int8", "UInt64", "UInt32", "UInt16", "UInt8")

STANDARD_TYPES: Mapping[str, str] = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/String": "string data",
    "std_msgs/Bool": "bool data",
    "std_msgs/MultiArrayDimension": "string label\nuint32 size\nuint32 stride",
    "std_msgs/MultiArrayLayout": "MultiArrayDimension[] dim\nuint32 data_offset",
    **{f"std_msgs/{name}": f"{name.lower()} data" for name in _NUMBERS},
    **{f"std_msgs/{name}MultiArray": f"MultiArrayLayout layout\n{name.lower()}[] data" for name in _NUMBERS},
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Wrench": "Vector3 force\nVector3 torque",
    "geometry_msgs/Pose": "Point position\nQuaternion orientation",
    "geometry_msgs/Twist": "Vector3 linear\nVector3 angular",
    "geometry_msgs/Accel": "Vector3 linear\nVector3 angular",
    "geometry_msgs/Transform": "Vector3 translation\nQuaternion rotation",
    **{f"geometry_msgs/{name}Stamped": f"Header header\n{name} {field}" for name, field in _STAMPED.items()},
    "geometry_msgs/PointStamped": "Header header\nPoint point",
    "geometry_msgs/Vector3Stamped": "Header header\nVector3 vector",
    "geometry_msgs/TransformStamped": "Header header\nstring child_frame_id\nTransform transform",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "diagnostic_msgs/KeyValue": "string key\nstring value",
    "diagnostic_msgs/DiagnosticStatus": (
        "byte level\nstring name\nstring message\nstring hardware_id\nKeyValue[] values"
    ),
    "diagnostic_msgs/DiagnosticArray": "Header header\nDiagnosticStatus[] status",
    "sensor_msgs/PointField": "string name\nuint32 offset\nuint8 datatype\nuint32 count",
    "sensor_msgs/PointCloud2": (
        "Header header\nuint32 height\nuint32 width\nPointField[] fields\nbool is_bigendian\nuint32 point_step\n"
        "uint32 row_step\nuint8[] data\nbool is_dense"
    ),
    "sensor_msgs/JointState": "Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort",
}
