"""What goes wrong with logs, at the size at which it happens; each spoils the two tables of a drive."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

Frame = Any  # pandas.DataFrame
EARTH_RADIUS_M = 6_371_000.0
FOOT_M = 0.3048
SEED = 7


@dataclass(frozen=True)
class Fault:
    """A fault."""

    words: str  # what it is, for people
    spoil: Callable[[Frame, Frame], tuple[Frame, Frame]]  # tables of subject vehicle and objects
    cause: str  # pattern of what a line must say that names it
    is_small: bool = False  # as small as should still be seen with eight drives


def _scaled(column: str, factor: float, of_subject: bool) -> Callable[[Frame, Frame], tuple[Frame, Frame]]:
    def spoil(subject: Frame, objects: Frame) -> tuple[Frame, Frame]:
        if of_subject:
            return subject.assign(**{column: subject[column] * factor}), objects
        return subject, objects.assign(**{column: objects[column] * factor})

    return spoil


def _late(late_s: float) -> Callable[[Frame, Frame], tuple[Frame, Frame]]:
    def spoil(subject: Frame, objects: Frame) -> tuple[Frame, Frame]:
        moved = objects.assign(time_s=(objects["time_s"] + late_s).round(3))
        return subject, moved[moved["time_s"] <= subject["time_s"].max()]

    return spoil


def _speeds_late(subject: Frame, objects: Frame) -> tuple[Frame, Frame]:
    late = np.interp(subject["time_s"] - 1.0, subject["time_s"], subject["speed_kmh"])
    return subject.assign(speed_kmh=late), objects


def _relative(subject: Frame, objects: Frame) -> tuple[Frame, Frame]:
    own = np.interp(objects["time_s"], subject["time_s"], subject["speed_kmh"])
    return subject, objects.assign(speed_kmh=objects["speed_kmh"] - own)


def _aside(aside_m: float) -> Callable[[Frame, Frame], tuple[Frame, Frame]]:
    def spoil(subject: Frame, objects: Frame) -> tuple[Frame, Frame]:
        north = np.gradient(subject["latitude_rad"])
        east = np.gradient(subject["longitude_rad"]) * np.cos(subject["latitude_rad"])
        length = np.hypot(north, east) + 1e-15
        north, east = _smooth(north / length), _smooth(east / length)
        moved_rad = aside_m / EARTH_RADIUS_M
        return subject.assign(
            latitude_rad=subject["latitude_rad"] + moved_rad * east,
            longitude_rad=subject["longitude_rad"] - moved_rad * north / np.cos(subject["latitude_rad"]),
        ), objects

    return spoil


def _smooth(values: np.ndarray) -> np.ndarray:
    return np.asarray(pd.Series(values).rolling(50, 1, center=True).mean())


def _backwards(subject: Frame, objects: Frame) -> tuple[Frame, Frame]:
    places = ["longitude_rad", "latitude_rad", "road", "lane", "lane_offset_m"]
    turned = subject[places].iloc[::-1].reset_index(drop=True)
    return subject.assign(**{name: turned[name].to_numpy() for name in places}), objects


def _itself(subject: Frame, objects: Frame) -> tuple[Frame, Frame]:
    random = np.random.default_rng(SEED)
    own = pd.DataFrame(
        {
            "time_s": subject["time_s"],
            "vehicle_id": 99991,
            "lane": subject["lane"],
            "relative_x_m": random.normal(0.0, 0.3, len(subject)),
            "relative_y_m": random.normal(0.0, 0.1, len(subject)),
            "speed_kmh": subject["speed_kmh"],
            "heading_deg": 0.0,
        }
    )
    return subject, pd.concat([objects, own], ignore_index=True)


def _doubled(share: float) -> Callable[[Frame, Frame], tuple[Frame, Frame]]:
    def spoil(subject: Frame, objects: Frame) -> tuple[Frame, Frame]:
        random = np.random.default_rng(SEED)
        ids = np.sort(objects["vehicle_id"].unique())
        chosen = random.choice(ids, max(1, round(share * len(ids))), replace=False)
        twice = objects[objects["vehicle_id"].isin(chosen)]
        moved = twice["relative_x_m"] + random.normal(0.0, 0.5, len(twice))
        twice = twice.assign(vehicle_id=twice["vehicle_id"] + 50_000, relative_x_m=moved)
        return subject, pd.concat([objects, twice], ignore_index=True)

    return spoil


def _passing(speed_mps: float, gap_s: float) -> Callable[[Frame, Frame], tuple[Frame, Frame]]:
    """Targets at a speed of their own beyond the left lane; below 0 they come towards the subject vehicle."""

    def spoil(subject: Frame, objects: Frame) -> tuple[Frame, Frame]:
        time_s = subject["time_s"].to_numpy()
        driven_m = np.concatenate([[0.0], np.cumsum(np.diff(time_s) * subject["speed_kmh"].to_numpy()[1:] / 3.6)])
        rows = []
        for number, begin_s in enumerate(np.arange(time_s[0], time_s[-1], gap_s)):
            place_m = np.interp(begin_s, time_s, driven_m) + 140.0 + speed_mps * (time_s - begin_s)
            relative_m = place_m - driven_m
            there = (np.abs(relative_m) < 140.0) & (time_s >= begin_s)
            columns = {
                "time_s": time_s[there],
                "vehicle_id": 70_000 + number,
                "lane": np.nan,
                "relative_x_m": relative_m[there],
                "relative_y_m": 3.5 if speed_mps >= 0.0 else 7.0,
                "speed_kmh": abs(speed_mps) * 3.6,
                "heading_deg": 0.0 if speed_mps >= 0.0 else 180.0,
            }
            rows.append(pd.DataFrame(columns))
        return subject, pd.concat([objects, *rows], ignore_index=True)

    return spoil


def _sentinels(subject: Frame, objects: Frame) -> tuple[Frame, Frame]:
    chosen = np.random.default_rng(SEED).random(len(objects)) < 0.01
    return subject, objects.assign(relative_x_m=objects["relative_x_m"].where(~chosen, 9999.0))


def _ahead_only(subject: Frame, objects: Frame) -> tuple[Frame, Frame]:
    return subject, objects[objects["relative_x_m"] > 0.0]


def _nobody(subject: Frame, objects: Frame) -> tuple[Frame, Frame]:
    return subject, objects.head(0)


def _later_clock(subject: Frame, objects: Frame) -> tuple[Frame, Frame]:
    return subject.assign(time_s=subject["time_s"] + 200.0), objects.assign(time_s=objects["time_s"] + 200.0)


def _in_mps(subject: Frame, objects: Frame) -> tuple[Frame, Frame]:
    return subject.assign(speed_kmh=subject["speed_kmh"] / 3.6), objects.assign(speed_kmh=objects["speed_kmh"] / 3.6)


FAULTS: Mapping[str, Fault] = {
    "all_mps": Fault("all speeds in m/s", _in_mps, r"3\.\d+ times too small.*m/s"),
    "own_mps": Fault("own speed in m/s", _scaled("speed_kmh", 1 / 3.6, True), r"3\.\d+ times too small.*m/s"),
    "own_mph": Fault("own speed in mph", _scaled("speed_kmh", 1 / 1.609344, True), r"1\.6\d* times too small.*mph"),
    "their_mps": Fault("objects' speeds in m/s", _scaled("speed_kmh", 1 / 3.6, False), r"3\.\d+ times too small.*m/s"),
    "relative": Fault("objects' speeds relative to one's own", _relative, r"relative to the subject"),
    "late_18": Fault("objects' clock 18 s late", _late(18.0), r"times are 1[78]\.\d+ (\+- \S+ )?s late"),
    "late_3": Fault("objects' clock 3 s late", _late(3.0), r"times are [23]\.\d+ (\+- \S+ )?s late"),
    "own_late": Fault("own speeds 1 s late", _speeds_late, r"speeds come \d\.\d+ s"),
    "sign": Fault("distances with the other sign", _scaled("relative_x_m", -1.0, False), r"sign|ahead"),
    "feet": Fault("distances in feet", _scaled("relative_x_m", 1 / FOOT_M, False), r"feet"),
    "backwards": Fault("a drive logged backwards", _backwards, r"against the direction"),
    "aside": Fault("places 12 m to the side", _aside(12.0), r"Places seem to lie 1\d\.\d m|to the side|aside"),
    "itself": Fault("the subject vehicle among its objects", _itself, r"subject vehicle among its own"),
    "quarter": Fault("every fourth vehicle twice", _doubled(0.25), r"there twice"),
    "oncoming": Fault("oncoming traffic", _passing(-30.0, 6.0), r"oncoming"),
    "standing": Fault("standing radar targets", _passing(0.0, 6.0), r"standing"),
    "sentinels": Fault("9999 for nothing in 1 % of the rows", _sentinels, r"stands for nothing"),
    "ahead_only": Fault("sensors that look ahead only", _ahead_only, r"objects are behind"),
    "nobody": Fault("no objects at all", _nobody, r"no rows|detect"),
    "accel_sign": Fault(
        "accelerations with the other sign", _scaled("acceleration_mps2", -1.0, True), r"opposite sign"
    ),
    "accel_g": Fault("accelerations in g", _scaled("acceleration_mps2", 1 / 9.80665, True), r"times too small: g"),
    "yaw_deg": Fault("yaw rates in degrees", _scaled("yaw_rate_radps", 57.2958, True), r"degrees"),
    "lane_zero": Fault("lanes counted from 0", lambda s, o: (s.assign(lane=s["lane"] - 1), o), r"from 0|from 1"),
    "depart": Fault("clock 200 s later than depart_s", _later_clock, r"after depart_s|scenario's clock"),
    "small_late": Fault("objects' clock 0.3 s late", _late(0.3), r"0\.[2-4]\d* (\+- \S+ )?s late", True),
    "small_speed": Fault("own speed 3 % off", _scaled("speed_kmh", 0.97, True), r"1\.0[23]", True),
    "small_their": Fault("objects' speeds 3 % off", _scaled("speed_kmh", 0.97, False), r"1\.0[23]", True),
    "small_distance": Fault("distances 3 % off", _scaled("relative_x_m", 1.03, False), r"1\.0[23]|0\.97", True),
    "small_aside": Fault("places 1 m to the side", _aside(1.0), r"[01]\.\d+ m", True),
    "small_doubles": Fault("5 % of the vehicles twice", _doubled(0.05), r"there twice", True),
}
