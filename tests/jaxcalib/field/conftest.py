"""A small road made here, drives on it, and the shared cases where they are installed."""

import re
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from jaxcalib.case.case import Case, Drive, Perception, Scenario
from jaxcalib.field.route_geometry import RouteGeometry, build_route_geometry
from sim_adapters.scenario.road_builder import RowMap, lay_rows
from sim_adapters.scenario.route_network import read_route_network
from tests.places import SHARED_CASES

LANE_WIDTH_M = 3.75
# `a` has 3 lanes, `b` an acceleration lane on the right of them, `c` 3 lanes and a bend. The left border of the road
# runs along these points; `c` is said to be 1 % longer than it is drawn.
EDGES = {
    "a": ([(0.0, 0.0), (300.0, 0.0)], 3, 300.0),
    "b": ([(303.0, 0.0), (503.0, 0.0)], 4, 200.0),
    "c": ([(511.0, 0.0), (611.0, 0.0), (703.0, 39.0)], 3, (100.0 + np.hypot(92.0, 39.0)) * 1.01),
}
LANES_ON = {("a", "b"): [(0, 1), (1, 2), (2, 3)], ("b", "c"): [(1, 0), (2, 1), (3, 2)]}
PROJECTION = "+proj=utm +zone=51 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"


def beside(points: list[tuple[float, float]], right_m: float) -> np.ndarray:
    """Return a polyline moved to the right."""
    line = np.asarray(points)
    step = np.diff(line, axis=0)
    normal = np.stack([step[:, 1], -step[:, 0]], axis=1) / np.hypot(step[:, 0], step[:, 1])[:, None]
    at_point = np.concatenate([normal[:1], (normal[1:] + normal[:-1]) / 2, normal[-1:]])
    return line + right_m * at_point / np.sum(at_point * at_point, axis=1, keepdims=True)


def lane_shape(edge: str, index: int) -> np.ndarray:
    points, num_lanes, _ = EDGES[edge]
    return beside(points, (num_lanes - index - 0.5) * LANE_WIDTH_M)


def small_net_xml(projection: str = PROJECTION) -> str:
    def shape(points: np.ndarray) -> str:
        return " ".join(f"{x:.3f},{y:.3f}" for x, y in points)

    def lane(name: str, index: int, points: np.ndarray, length: float) -> str:
        return (
            f'<lane id="{name}" index="{index}" speed="22.22" length="{length:.3f}" width="{LANE_WIDTH_M}" '
            f'shape="{shape(points)}"/>'
        )

    edges, internal, connections = [], [], []
    for number, (edge, (_, num_lanes, length)) in enumerate(EDGES.items()):
        lanes = "".join(lane(f"{edge}_{k}", k, lane_shape(edge, k), length) for k in range(num_lanes))
        edges.append(f'<edge id="{edge}" from="n{number}" to="n{number + 1}" priority="10">{lanes}</edge>')
    for number, ((before, after), pairs) in enumerate(LANES_ON.items(), start=1):
        lanes = ""
        for k, (source, target) in enumerate(pairs):
            way = np.stack([lane_shape(before, source)[-1], lane_shape(after, target)[0]])
            lanes += lane(f":n{number}_0_{k}", k, way, float(np.hypot(*(way[1] - way[0]))))
            link = f'fromLane="{source}" toLane="{target}" via=":n{number}_0_{k}" dir="s" state="M"'
            connections.append(f'<connection from="{before}" to="{after}" {link}/>')
            link = f'fromLane="{k}" toLane="{target}" dir="s" state="M"'
            connections.append(f'<connection from=":n{number}_0" to="{after}" {link}/>')
        internal.append(f'<edge id=":n{number}_0" function="internal">{lanes}</edge>')
    junctions = [
        f'<junction id="n{n}" type="priority" x="0" y="0" incLanes="" intLanes="" shape=""/>' for n in range(4)
    ]
    location = (
        '<location netOffset="-685984.61,-4863735.27" convBoundary="0.00,0.00,3049.95,1228.14" '
        f'origBoundary="125.315974,43.903258,125.354358,43.913530" projParameter="{projection}"/>'
    )
    parts = [location, *internal, *edges, *junctions, *connections]
    return f'<net version="1.20" junctionCornerDetail="5">{"".join(parts)}</net>'


def read_row_map(file: Path) -> RowMap:
    return lay_rows(read_route_network(file, tuple(EDGES), [tuple(EDGES)]))


@pytest.fixture(scope="session")
def row_map(tmp_path_factory: pytest.TempPathFactory) -> RowMap:
    file = tmp_path_factory.mktemp("net") / "net.net.xml"
    file.write_text(small_net_xml())
    return read_row_map(file)


@pytest.fixture
def row_map_projected(tmp_path: Path) -> Callable[[str | None], RowMap]:
    """Return what reads the road from a network with another projection; None for one without a location."""

    def read(projection: str | None) -> RowMap:
        file = tmp_path / "plain.net.xml"
        text = small_net_xml(projection or "")
        file.write_text(text if projection is not None else re.sub("<location[^>]*>", "", text))
        return read_row_map(file)

    return read


@pytest.fixture(scope="session")
def geometry(row_map: RowMap) -> RouteGeometry:
    return build_route_geometry(row_map)


@pytest.fixture(scope="session")
def to_lon_lat(row_map: RowMap) -> Callable[[np.ndarray], np.ndarray]:
    """Return the inverse of the projection: points in the plane to longitude and latitude in radians."""

    def inverse(xy: np.ndarray) -> np.ndarray:
        net = row_map.network.net
        return np.radians([net.convertXY2LonLat(float(x), float(y)) for x, y in xy])

    return inverse


@pytest.fixture(scope="session")
def lane_point() -> Callable[[str, int, float], np.ndarray]:
    """Return the point at a place of a lane, as SUMO draws it: scaled to the length that the network states."""

    def point(edge: str, index: int, place_m: float) -> np.ndarray:
        shape = lane_shape(edge, index)
        drawn = np.append(0.0, np.cumsum(np.hypot(*np.diff(shape, axis=0).T)))
        at = place_m / EDGES[edge][2] * drawn[-1]
        return np.asarray([np.interp(at, drawn, shape[:, 0]), np.interp(at, drawn, shape[:, 1])])

    return point


@pytest.fixture
def drive_case(tmp_path: Path) -> Case:
    """A case with one drive whose tables are not there yet."""
    drive = Drive("d01", 10.0, tmp_path / "d01_subject.csv", tmp_path / "d01_objects.csv", "fit")
    scenario = Scenario(tmp_path / "scenario.sumocfg", 5.0, 100.0, 0.1)
    return Case(tmp_path, "small", Perception(100.0, 80.0, 4.8), (drive,), scenario, None, None, ())


@pytest.fixture
def straight_drive(
    lane_point: Callable[[str, int, float], np.ndarray], to_lon_lat: Callable[[np.ndarray], np.ndarray]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The tables of a drive: 20 m/s in row 0 from 250 m to 350 m, 10 rows per second.

    Object 7 drives 20 m ahead in row 1, object 9 10 m behind in row 0, both at 20 m/s.
    """
    time_s = np.round(10.0 + 0.1 * np.arange(51), 1)
    position = 250.0 + 20.0 * (time_s - 10.0)
    on_a = position < 300.0  # between the edges the lanes of `b` are counted, as in the shared cases
    points = [lane_point("a", 0, p) if p <= 300.0 else lane_point("b", 1, p - 303.0) for p in position]
    points = [np.asarray([p, points[0][1]]) for p in position]
    lon_lat = to_lon_lat(np.asarray(points))
    subject = pd.DataFrame(
        {
            "time_s": time_s,
            "road": np.where(on_a, "a", "b"),
            "speed_limit_kmh": 80.0,
            "speed_kmh": 72.0,
            "yaw_rate_radps": 0.0,
            "longitude_rad": lon_lat[:, 0],
            "latitude_rad": lon_lat[:, 1],
            "acceleration_mps2": 0.0,
            "lane": np.where(on_a, 1, 2),
            "lane_offset_m": -1.88,
        }
    )
    objects = pd.concat(
        [
            pd.DataFrame(
                {
                    "time_s": time_s,
                    "vehicle_id": vehicle,
                    "lane": np.where(position + x < 300.0, row + 1, row + 2),
                    "relative_x_m": x,
                    "relative_y_m": row * LANE_WIDTH_M,
                    "speed_kmh": 72.0,
                    "heading_deg": 0.0,
                }
            )
            for vehicle, row, x in [(7, 1, 20.0), (9, 0, -10.0)]
        ],
        ignore_index=True,
    )
    return subject, objects


@pytest.fixture(scope="session")
def shared_cases() -> Path:
    """The folder of the shared cases: $JAXCALIB_SHARED/cases, else shared/cases beside the repository."""
    folder = SHARED_CASES
    if not folder.is_dir():
        pytest.skip(f"the shared cases are not installed: no folder {folder}; set JAXCALIB_SHARED to what holds it")
    return folder


@pytest.fixture(scope="session")
def row_map_of() -> Callable[[Path], RowMap]:
    """Return the rows of a shared case; its subject vehicle's route is `r_ego`."""

    def read(folder: Path) -> RowMap:
        routes = {}
        for route in ElementTree.parse(folder / "scenario/demand.rou.xml").getroot().iter("route"):
            routes[route.get("id")] = (route.get("edges") or "").split()
        network = read_route_network(folder / "scenario/net.net.xml", routes["r_ego"], list(routes.values()))
        return lay_rows(network)

    return read
