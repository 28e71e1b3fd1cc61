"""The types of messages that can be read, and what is read of each."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

VELOCITY = ("velocity_x_mps", "velocity_y_mps")
DETECTION = "vision_msgs/Detection3DArray"  # without velocities and often without ids: taken only if it is named

_AUTOWARE = ("autoware_perception_msgs", "autoware_auto_perception_msgs")  # the second is the older

Rows = Iterable[tuple[Any, ...]]  # of a message, in the columns of its kind


def _yaw_rad(turn: Any) -> float:
    """Angle of a quaternion around the vertical axis; nan where nobody filled it in."""
    x, y, z, w = turn.x, turn.y, turn.z, turn.w
    if x * x + y * y + z * z + w * w < 0.5:
        return math.nan
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _odometry(message: Any) -> Rows:
    pose, twist = message.pose.pose, message.twist.twist
    speed_mps = math.hypot(twist.linear.x, twist.linear.y)
    yield pose.position.x, pose.position.y, _yaw_rad(pose.orientation), speed_mps, twist.angular.z


def _fix(message: Any) -> Rows:
    if message.status.status >= 0 and math.isfinite(message.longitude + message.latitude):  # below 0: no fix
        yield message.longitude, message.latitude


def _velocity_report(message: Any) -> Rows:
    yield math.hypot(message.longitudinal_velocity, message.lateral_velocity), message.heading_rate


def _twist(message: Any) -> Rows:
    twist = getattr(message.twist, "twist", message.twist)
    yield math.hypot(twist.linear.x, twist.linear.y), twist.angular.z


def _accel(message: Any) -> Rows:
    yield (message.accel.accel.linear.x,)


def _imu(message: Any) -> Rows:
    yield (message.linear_acceleration.x,)


def _autoware(message: Any) -> Rows:
    """Tracked, predicted and detected objects; their velocities are along and across themselves."""
    for one in message.objects:
        motion = one.kinematics
        first = "initial_" if hasattr(motion, "initial_pose_with_covariance") else ""
        pose = getattr(motion, f"{first}pose_with_covariance").pose
        speed = getattr(motion, f"{first}twist_with_covariance").twist.linear
        yaw_rad = _yaw_rad(pose.orientation)
        cos, sin = (math.cos(yaw_rad), math.sin(yaw_rad)) if getattr(motion, "has_twist", True) else (math.nan,) * 2
        name = bytes(one.object_id.uuid).hex() if hasattr(one, "object_id") else ""
        label = max(one.classification, key=lambda each: each.probability).label if len(one.classification) else 0
        kind = "unknown" if label == 0 else "vehicle" if label <= 5 else "other"  # 6 and more: bicycles, pedestrians
        length_m = one.shape.dimensions.x if one.shape.type == 0 else math.nan  # 0 is a box
        velocity_mps = cos * speed.x - sin * speed.y, sin * speed.x + cos * speed.y
        yield name, pose.position.x, pose.position.y, yaw_rad, *velocity_mps, length_m, kind


def _derived(message: Any) -> Rows:
    """Objects of derived_object_msgs; their velocities are in the frame of the header."""
    for one in message.objects:
        place, speed = one.pose.position, one.twist.linear
        known = one.classification if one.object_classified else 0
        kind = "unknown" if known < 4 else "other" if known in (4, 5, 10, 11) else "vehicle"  # pedestrians, signs
        length_m = one.shape.dimensions[0] if one.shape.type == 1 and len(one.shape.dimensions) else math.nan
        yield str(one.id), place.x, place.y, _yaw_rad(one.pose.orientation), speed.x, speed.y, length_m, kind


def _detection(message: Any) -> Rows:
    """Boxes of vision_msgs, without velocities."""
    for one in message.detections:
        name = getattr(one, "id", "") or getattr(one, "tracking_id", "")
        place, turn = one.bbox.center.position, one.bbox.center.orientation
        yield name, place.x, place.y, _yaw_rad(turn), math.nan, math.nan, one.bbox.size.x, "unknown"


# Of each kind: types of messages, those that are preferred first, and how they are read.
TYPES: Mapping[str, Mapping[str, Callable[[Any], Rows]]] = {
    "odometry": {"nav_msgs/Odometry": _odometry},
    "fix": {"sensor_msgs/NavSatFix": _fix},
    "speed": {
        "autoware_vehicle_msgs/VelocityReport": _velocity_report,
        "autoware_auto_vehicle_msgs/VelocityReport": _velocity_report,
        "geometry_msgs/TwistWithCovarianceStamped": _twist,
        "geometry_msgs/TwistStamped": _twist,  # last, for it may be what was asked of the vehicle
    },
    "acceleration": {"geometry_msgs/AccelWithCovarianceStamped": _accel, "sensor_msgs/Imu": _imu},
    "objects": {
        **{f"{package}/{name}": _autoware for name in ("TrackedObjects", "PredictedObjects") for package in _AUTOWARE},
        "derived_object_msgs/ObjectArray": _derived,
        **{f"{package}/DetectedObjects": _autoware for package in _AUTOWARE},
        DETECTION: _detection,
    },
}

# Of each kind: what its rows hold.
COLUMNS: Mapping[str, tuple[str, ...]] = {
    "odometry": ("x_m", "y_m", "heading_rad", "speed_mps", "yaw_rate_radps"),
    "fix": ("longitude_deg", "latitude_deg"),
    "speed": ("speed_mps", "yaw_rate_radps"),
    "acceleration": ("acceleration_mps2",),
    "objects": ("vehicle_id", "x_m", "y_m", "yaw_rad", *VELOCITY, "length_m", "kind"),
}
