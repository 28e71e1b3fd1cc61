"""What the physics of a drive is judged by, from its tables and where the road has them."""

import numpy as np

from jaxcalib.case.case import Drive
from jaxcalib.field.log_tables import LANE_UNKNOWN, ObjectLog, SubjectLog
from jaxcalib.field.map_matching import lane_centre_m
from jaxcalib.field.matched_subject import MatchedSubject
from jaxcalib.field.physics.motion import DriveMotion
from jaxcalib.field.route_geometry import RouteGeometry


def logged_motion(
    geometry: RouteGeometry, drive: Drive, subject_log: SubjectLog, subject: MatchedSubject, object_log: ObjectLog
) -> DriveMotion:
    """Return a drive's motion as its log has it."""
    table, row = subject.table, subject.log_row
    is_named = (subject_log.lane[row] != LANE_UNKNOWN) & geometry.has_lanes
    lateral_m = subject.across_m - lane_centre_m(geometry, subject.edge, table.row)
    side = -1.0 if geometry.is_mirrored else 1.0
    return DriveMotion(
        id=drive.id,
        role=drive.role,
        subject_file=drive.subject_file,
        objects_file=drive.objects_file,
        time_s=table.time_s,
        position_m=table.position_m,
        speed_mps=table.speed_mps,
        acceleration_mps2=subject_log.acceleration_mps2[row],
        yaw_rate_radps=subject.yaw_rate_radps,
        heading_rad=side * _heading_rad(geometry, table.position_m, table.row),
        lateral_m=side * np.where(is_named, lateral_m, np.nan),
        across_m=side * subject.across_m,
        object_time_s=object_log.time_s,
        vehicle=object_log.vehicle,
        relative_x_m=object_log.relative_x_m,
        relative_y_m=object_log.relative_y_m,
        object_speed_mps=object_log.speed_mps,
        speed_limit_mps=subject_log.speed_limit_mps[row],
    )


def _heading_rad(geometry: RouteGeometry, position_m: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Direction of the road at places in rows, in the plane, without jumps of a whole turn."""
    heading_rad = np.full(len(position_m), np.nan)
    for number, in_row in enumerate(geometry.by_row):
        mine = np.flatnonzero(row == number)
        if len(mine) and len(in_row):
            segment = in_row[np.searchsorted(geometry.begin_m[in_row], position_m[mine], side="right") - 1]
            heading_rad[mine] = np.arctan2(geometry.step_xy[segment, 1], geometry.step_xy[segment, 0])
    return np.unwrap(heading_rad)
