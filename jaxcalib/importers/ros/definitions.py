"""The layouts of messages whose definitions neither a database of ROS 2 Humble nor the library `rosbags` holds."""

from collections.abc import Mapping
from functools import cache

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

# Facts of published packages: names and types of fields in their order, a name of a type above them. CDR writes values
# one after the other without names, so that only the order tells which is which: what is not certain is not here.

# Alike in autoware_perception_msgs (Autoware Foundation, Apache-2.0; from 1.1.0, the first with these messages, to
# 1.11.0 nothing of it has changed) and in autoware_auto_perception_msgs 1.0.0 as TIER IV has published it for Autoware
# Universe (Apache-2.0). The package of the same name for Autoware.Auto has other layouts, of other lengths.
_OBJECTS = """
DetectedObjects
std_msgs/Header header
DetectedObject[] objects

DetectedObject
float32 existence_probability
ObjectClassification[] classification
DetectedObjectKinematics kinematics
Shape shape

DetectedObjectKinematics
geometry_msgs/PoseWithCovariance pose_with_covariance
bool has_position_covariance
uint8 orientation_availability
geometry_msgs/TwistWithCovariance twist_with_covariance
bool has_twist
bool has_twist_covariance

TrackedObjects
std_msgs/Header header
TrackedObject[] objects

TrackedObject
unique_identifier_msgs/UUID object_id
float32 existence_probability
ObjectClassification[] classification
TrackedObjectKinematics kinematics
Shape shape

PredictedObjects
std_msgs/Header header
PredictedObject[] objects

PredictedObject
unique_identifier_msgs/UUID object_id
float32 existence_probability
ObjectClassification[] classification
PredictedObjectKinematics kinematics
Shape shape

PredictedObjectKinematics
geometry_msgs/PoseWithCovariance initial_pose_with_covariance
geometry_msgs/TwistWithCovariance initial_twist_with_covariance
geometry_msgs/AccelWithCovariance initial_acceleration_with_covariance
PredictedPath[] predicted_paths

PredictedPath
geometry_msgs/Pose[] path
builtin_interfaces/Duration time_step
float32 confidence

ObjectClassification
uint8 label
float32 probability

Shape
uint8 type
geometry_msgs/Polygon footprint
geometry_msgs/Vector3 dimensions
"""

# Here the two packages differ: the order is another.
_TRACKED_KINEMATICS = """
TrackedObjectKinematics
geometry_msgs/PoseWithCovariance pose_with_covariance
geometry_msgs/TwistWithCovariance twist_with_covariance
geometry_msgs/AccelWithCovariance acceleration_with_covariance
uint8 orientation_availability
bool is_stationary
"""
_OLDER_TRACKED_KINEMATICS = """
TrackedObjectKinematics
geometry_msgs/PoseWithCovariance pose_with_covariance
uint8 orientation_availability
geometry_msgs/TwistWithCovariance twist_with_covariance
geometry_msgs/AccelWithCovariance acceleration_with_covariance
bool is_stationary
"""

# autoware_vehicle_msgs 1.1.0 to 1.11.0 and TIER IV's autoware_auto_vehicle_msgs 1.0.0 (both Apache-2.0).
_VELOCITY = """
VelocityReport
std_msgs/Header header
float32 longitudinal_velocity
float32 lateral_velocity
float32 heading_rate
"""

# derived_object_msgs 2.2.1 to 4.0.0 (AutonomouStuff, MIT); its shape_msgs/SolidPrimitive is that of Humble and later.
_DERIVED = """
ObjectArray
std_msgs/Header header
derived_object_msgs/Object[] objects

Object
std_msgs/Header header
uint32 id
uint8 detection_level
bool object_classified
geometry_msgs/Pose pose
geometry_msgs/Twist twist
geometry_msgs/Accel accel
geometry_msgs/Polygon polygon
shape_msgs/SolidPrimitive shape
uint8 classification
uint8 classification_certainty
uint32 classification_age
"""

# Of each package: the version that it is called in messages, and its types.
_PACKAGES: Mapping[str, tuple[str, str]] = {
    "autoware_perception_msgs": ("1.11.0", _OBJECTS + _TRACKED_KINEMATICS),
    "autoware_auto_perception_msgs": ("1.0.0 (TIER IV)", _OBJECTS + _OLDER_TRACKED_KINEMATICS),
    "autoware_vehicle_msgs": ("1.11.0", _VELOCITY),
    "autoware_auto_vehicle_msgs": ("1.0.0 (TIER IV)", _VELOCITY),
    "derived_object_msgs": ("4.0.0", _DERIVED),
}


def _definitions() -> dict[str, str]:
    texts = {}
    for package, (_, types) in _PACKAGES.items():
        for block in types.strip().split("\n\n"):
            name, _, fields = block.partition("\n")
            texts[f"{package}/msg/{name}"] = fields
    return texts


# Of each type by its whole name: its fields.
DEFINITIONS: Mapping[str, str] = _definitions()


def source_of(message_type: str) -> str:
    """Package and version that a type of `DEFINITIONS` is taken from."""
    package = message_type.partition("/")[0]
    return f"{package} {_PACKAGES[package][0]}"


@cache
def typestore() -> Typestore:
    """The types for bags without definitions: those that the library knows, and of `DEFINITIONS` the others."""
    store = get_typestore(Stores.LATEST)
    types = {}
    for name, fields in DEFINITIONS.items():
        if name not in store.fielddefs:
            types |= get_types_from_msg(fields, name)
    store.register(types)
    return store
