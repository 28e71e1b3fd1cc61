"""Middles of the lanes of an ASAM OpenDRIVE file, as far as netconvert makes use of the standard."""

import itertools
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

SAMPLE_M = 0.25


def lane_middles_m(file: Path) -> np.ndarray:
    """Points along the middle of every lane that vehicles drive on, [point, 2]."""
    points = []
    for road in ET.parse(file).getroot().iter("road"):
        for geometry in road.iter("geometry"):
            s_m, line, left = _reference_line(geometry)
            for t_m in _lane_offsets_m(road, s_m):
                points.append(line + t_m[:, None] * left)
    middles = np.concatenate(points)
    return middles[np.isfinite(middles).all(axis=1)]


def _reference_line(geometry: ET.Element) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places along the road, points there and unit vectors to the left."""
    begin_m, x_m, y_m, heading_rad, length_m = (
        float(geometry.attrib[name]) for name in ("s", "x", "y", "hdg", "length")
    )
    along_m = np.linspace(0.0, length_m, max(2, round(length_m / SAMPLE_M)))
    (shape,) = geometry
    if shape.tag == "line":
        u, v = along_m, np.zeros_like(along_m)
        du, dv = np.ones_like(u), v
    else:
        assert (shape.tag, shape.get("pRange")) == ("paramPoly3", "normalized")
        p = along_m / length_m
        u, v = (sum(float(shape.attrib[f"{n}{axis}"]) * p**k for k, n in enumerate("abcd")) for axis in "UV")
        du, dv = (
            sum(k * float(shape.attrib[f"{n}{axis}"]) * p ** max(k - 1, 0) for k, n in enumerate("abcd"))
            for axis in "UV"
        )
    turn = np.asarray([[np.cos(heading_rad), -np.sin(heading_rad)], [np.sin(heading_rad), np.cos(heading_rad)]])
    line = np.stack([u, v], axis=1) @ turn.T + (x_m, y_m)
    left = np.stack([-dv, du], axis=1) / np.hypot(du, dv)[:, None]
    return begin_m + along_m, line, left @ turn.T


def _lane_offsets_m(road: ET.Element, s_m: np.ndarray) -> list[np.ndarray]:
    """For each lane how far its middle is to the left of the reference line; nan outside its section."""
    offset_m = np.zeros_like(s_m)
    for offset in road.findall("lanes/laneOffset"):
        own_m = s_m - float(offset.attrib["s"])
        offset_m = np.where(own_m >= 0.0, _cubic(offset, own_m), offset_m)
    sections = road.findall("lanes/laneSection")
    bounds = [float(section.attrib["s"]) for section in sections] + [np.inf]
    offsets = []
    for section, (begin_m, end_m) in zip(sections, itertools.pairwise(bounds), strict=True):
        for side, sign in (("right", -1.0), ("left", 1.0)):
            edge_m = np.zeros_like(s_m)
            for lane in sorted(section.findall(f"{side}/lane"), key=lambda one: abs(int(one.attrib["id"]))):
                (width,) = lane.findall("width")
                width_m = _cubic(width, s_m - begin_m)
                middle_m = offset_m + sign * (edge_m + 0.5 * width_m)
                edge_m = edge_m + width_m
                if lane.get("type") == "driving":
                    offsets.append(np.where((s_m >= begin_m) & (s_m <= end_m), middle_m, np.nan))
    return offsets


def _cubic(element: ET.Element, along_m: np.ndarray) -> np.ndarray:
    return sum((float(element.attrib[name]) * along_m**power for power, name in enumerate("abcd")), np.zeros(()))
