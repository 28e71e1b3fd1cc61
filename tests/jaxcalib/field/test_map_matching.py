"""Points made from the network's own lanes are found again; lane numbers are turned into rows."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxcalib.errors import CaseError
from jaxcalib.field.log_checks import refuse_lanes
from jaxcalib.field.log_tables import LANE_UNKNOWN
from jaxcalib.field.logged_place import LoggedPlace
from jaxcalib.field.map_matching import (
    ROAD_REACH_M,
    beyond_ends_m,
    lane_centre_m,
    match_lanes,
    match_points,
    match_points_in_rows,
)
from jaxcalib.field.route_geometry import RouteGeometry, build_route_geometry
from sim_adapters.scenario.road_builder import RowMap

LANE_WIDTH_M = 3.75
LANES = [("a", 0), ("a", 1), ("a", 2), ("b", 0), ("b", 1), ("b", 3), ("c", 0), ("c", 2)]
EDGE = {"a": 0, "b": 1, "c": 2}
START_M = {"a": 0.0, "b": 303.0, "c": 511.0}

Point = Callable[[str, int, float], np.ndarray]


def test_the_axis_is_that_of_the_road(geometry: RouteGeometry, row_map: RowMap):
    assert geometry.edges == ("a", "b", "c")
    np.testing.assert_allclose(geometry.edge_start_m, [0.0, 303.0, 511.0], atol=1e-3)
    np.testing.assert_array_equal(geometry.num_lanes, [3, 4, 3])
    np.testing.assert_array_equal(geometry.row_of_lane, [[0, 1, 2, -1], [3, 0, 1, 2], [0, 1, 2, -1]])
    assert geometry.route_length_m == row_map.network.length_m


def test_the_coordinate_across_does_not_jump_where_the_auxiliary_lane_begins(geometry: RouteGeometry):
    for row in range(3):
        centre = lane_centre_m(geometry, np.arange(3), np.full(3, row))
        np.testing.assert_allclose(centre, (row + 0.5) * LANE_WIDTH_M, atol=1e-9)
    np.testing.assert_allclose(lane_centre_m(geometry, np.asarray([1]), np.asarray([3])), -LANE_WIDTH_M / 2)
    assert np.isnan(lane_centre_m(geometry, np.asarray([0]), np.asarray([3])))


@pytest.mark.parametrize(("edge", "index"), LANES)
def test_points_of_a_lane_are_found_again(geometry: RouteGeometry, lane_point: Point, edge: str, index: int):
    length = float(geometry.edge_end_m[EDGE[edge]] - geometry.edge_start_m[EDGE[edge]])
    place = np.linspace(0.5, length - 0.5, 97)
    found = match_points(geometry, np.asarray([lane_point(edge, index, p) for p in place]))
    np.testing.assert_allclose(found.position_m, START_M[edge] + place, atol=0.05)
    np.testing.assert_allclose(found.lateral_m, 0.0, atol=0.002)
    assert set(found.row) == {geometry.row_of_lane[EDGE[edge], index]}


def test_places_before_the_route_and_behind_it_are_known_as_such(geometry: RouteGeometry, lane_point: Point):
    begin, inside = lane_point("a", 1, 0.0), lane_point("a", 1, 40.0)
    along = (inside - begin) / np.hypot(*(inside - begin))
    aside = np.asarray([-along[1], along[0]])
    last = float(geometry.edge_end_m[2] - geometry.edge_start_m[2])
    end, before_end = lane_point("c", 1, last - 0.01), lane_point("c", 1, last - 40.0)
    on = (end - before_end) / np.hypot(*(end - before_end))
    points = [begin - 55.0 * along, begin - 55.0 * along + 2.0 * ROAD_REACH_M * aside, inside, end + 12.0 * on]
    np.testing.assert_allclose(beyond_ends_m(geometry, np.asarray(points)), [55.0, 0.0, 0.0, 12.0], atol=0.1)


@given(
    lane=st.sampled_from(LANES),
    share=st.floats(0.01, 0.99),
    left_m=st.floats(-1.7, 1.7),
)
def test_a_known_offset_is_found_again(
    geometry: RouteGeometry, lane_point: Point, lane: tuple[str, int], share: float, left_m: float
):
    edge, index = lane
    length = float(geometry.edge_end_m[EDGE[edge]] - geometry.edge_start_m[EDGE[edge]])
    place = share * length
    if edge == "c" and abs(place - 100.0) < 5.0:
        place = 90.0  # around the bend the foot of the perpendicular is on either side
    ahead = lane_point(edge, index, place + 0.01) - lane_point(edge, index, place - 0.01)
    normal = np.asarray([-ahead[1], ahead[0]]) / np.hypot(*ahead)
    point = (lane_point(edge, index, place) + left_m * normal)[None]
    found = match_points(geometry, point)
    np.testing.assert_allclose(found.position_m, START_M[edge] + place, atol=0.05)
    np.testing.assert_allclose(found.lateral_m, left_m, atol=0.01)
    np.testing.assert_allclose(found.distance_m, abs(left_m), atol=0.01)
    assert found.row[0] == geometry.row_of_lane[EDGE[edge], index]


def test_between_two_edges_positions_go_on(geometry: RouteGeometry):
    x = np.linspace(499.0, 515.0, 33)
    found = match_points(geometry, np.stack([x, np.full(33, -1.5 * LANE_WIDTH_M)], axis=1))
    np.testing.assert_allclose(found.position_m[x < 511.0], x[x < 511.0], atol=0.01)
    np.testing.assert_allclose(found.position_m[x > 511.0], 511.0 + 1.01 * (x[x > 511.0] - 511.0), atol=0.05)
    assert set(found.row) == {1}


def test_a_point_is_found_in_the_row_that_is_asked_for(geometry: RouteGeometry):
    xy = np.asarray([[100.0, -2.5 * LANE_WIDTH_M], [100.0, -2.5 * LANE_WIDTH_M]])
    found = match_points_in_rows(geometry, xy, np.asarray([0, 1]), np.asarray([100.0, 100.0]))
    np.testing.assert_allclose(found.position_m, 100.0, atol=1e-6)
    np.testing.assert_allclose(found.lateral_m, [0.0, -LANE_WIDTH_M], atol=1e-3)
    np.testing.assert_array_equal(found.row, [0, 1])


def test_the_projection_is_that_of_sumolib(geometry: RouteGeometry, row_map: RowMap, to_lon_lat: Callable):
    xy = np.asarray([[0.0, 0.0], [350.25, -7.5], [700.0, 39.0]])
    lon_lat = to_lon_lat(xy)
    found = LoggedPlace("globe", lon_lat[:, 0], lon_lat[:, 1]).points(geometry, np.arange(len(lon_lat)))
    np.testing.assert_allclose(found, xy, atol=1e-5)
    by_sumolib = [row_map.network.net.convertLonLat2XY(*np.degrees(place)) for place in lon_lat]
    np.testing.assert_allclose(found, by_sumolib, atol=1e-9)


@pytest.mark.parametrize("projection", ["!", "-", "UTM", "+proj=utm +zone=999", None])
def test_a_network_without_a_projection_of_proj_knows_no_longitude(
    projection: str | None, row_map_projected: Callable[[str | None], RowMap]
):
    """SUMO calls none "!", and "-" and "UTM" are ways of its own from degrees to metres."""
    assert not build_route_geometry(row_map_projected(projection)).has_projection


def test_places_in_the_plane_and_on_edges_are_those_on_the_globe(
    geometry: RouteGeometry, row_map: RowMap, to_lon_lat: Callable
):
    for number, edge in enumerate(geometry.edges):
        length_m = float(geometry.edge_end_m[number] - geometry.edge_start_m[number])
        along_m = np.asarray([0.13, 0.5, 0.87]) * length_m
        on_edge = LoggedPlace("edge", np.full(3, edge, object), along_m).points(geometry, np.arange(3))
        lon_lat = to_lon_lat(on_edge)
        on_globe = LoggedPlace("globe", lon_lat[:, 0], lon_lat[:, 1]).points(geometry, np.arange(3))
        in_plane = LoggedPlace("plane", on_edge[:, 0], on_edge[:, 1]).points(geometry, np.arange(3))
        np.testing.assert_allclose(on_globe, on_edge, atol=1e-5)
        np.testing.assert_array_equal(in_plane, on_edge)
        matched = match_points(geometry, on_edge)
        np.testing.assert_allclose(matched.position_m, geometry.edge_start_m[number] + along_m, atol=0.02)
        np.testing.assert_allclose(matched.lateral_m, 0.0, atol=0.01)


def lanes_of(geometry: RouteGeometry, position_m: float, across_m: float, lane: int):
    position = np.asarray([position_m])
    return match_lanes(geometry, position, np.asarray([across_m]), np.asarray([lane]), geometry.edge_at(position))


@pytest.mark.parametrize(
    ("position_m", "row_across", "lane", "row"),
    [
        (100.0, 1, 2, 1),  # plainly on `a`
        (400.0, 1, 3, 1),  # on `b` every number is one higher
        (400.0, -1, 1, 3),  # the auxiliary lane itself
        (299.0, 0, 2, 0),  # still on `a`, counted on `b` already
        (304.0, 0, 1, 0),  # already on `b`, counted on `a` still
        (301.5, 0, 1, 0),  # between the two, counted on `a`
        (301.5, 0, 2, 0),  # and on `b`
        (501.0, 2, 3, 2),  # still on `b`, counted on `c` already
        (515.0, 2, 4, 2),  # already on `c`, counted on `b` still
        (325.0, 0, 1, 0),  # a sensor that reports late or reads too far
    ],
)
def test_numbers_of_lanes_near_a_border(
    geometry: RouteGeometry, position_m: float, row_across: int, lane: int, row: int
):
    found = lanes_of(geometry, position_m, (row_across + 0.5) * LANE_WIDTH_M + 0.3, lane)
    assert found.row[0] == row
    np.testing.assert_allclose(found.lateral_m, 0.3, atol=1e-9)
    assert not found.contradicts[0]
    assert not found.no_such_lane[0]


def test_without_a_place_across_the_number_alone_counts(geometry: RouteGeometry):
    found = lanes_of(geometry, 400.0, np.nan, 3)
    assert found.row[0] == 1
    assert np.isnan(found.lateral_m[0])
    assert not found.contradicts[0]
    beyond_border = lanes_of(geometry, 299.0, np.nan, 4)
    assert beyond_border.row[0] == 2


def test_without_a_number_the_place_across_counts(geometry: RouteGeometry):
    found = lanes_of(geometry, 100.0, 1.7 * LANE_WIDTH_M, LANE_UNKNOWN)
    assert found.row[0] == 1
    np.testing.assert_allclose(found.lateral_m, 0.2 * LANE_WIDTH_M, atol=1e-9)
    assert lanes_of(geometry, 400.0, -0.4 * LANE_WIDTH_M, LANE_UNKNOWN).row[0] == 3


def test_beside_the_carriageway_there_is_no_lane(geometry: RouteGeometry):
    found = lanes_of(geometry, 100.0, -0.5 * LANE_WIDTH_M, LANE_UNKNOWN)
    assert found.off_road[0]
    assert found.row[0] == -1


def test_neither_number_nor_place(geometry: RouteGeometry):
    found = lanes_of(geometry, 100.0, np.nan, LANE_UNKNOWN)
    assert found.unknown[0]
    assert found.row[0] == -1


def test_a_number_that_contradicts_the_place_counts_and_is_told(geometry: RouteGeometry):
    found = lanes_of(geometry, 100.0, 0.5 * LANE_WIDTH_M, 3)
    assert found.row[0] == 2
    assert found.contradicts[0]
    assert np.isnan(found.lateral_m[0])


def test_a_lane_that_the_road_does_not_have(geometry: RouteGeometry):
    found = lanes_of(geometry, 100.0, 3.5 * LANE_WIDTH_M, 4)
    assert found.no_such_lane[0]
    assert found.row[0] == -1


@pytest.mark.parametrize(("position_m", "misplaced"), [(240.0, True), (205.0, True), (200.0, False), (590.0, True)])
def test_a_lane_that_the_road_has_a_little_farther_on(geometry: RouteGeometry, position_m: float, misplaced: bool):
    found = lanes_of(geometry, position_m, np.nan, 4)  # `b`, from 300 to 500 m, has four
    assert found.no_such_lane[0]
    assert found.misplaced[0] == misplaced
    assert not lanes_of(geometry, position_m, np.nan, 5).misplaced[0]
    assert not lanes_of(geometry, position_m, np.nan, 3).misplaced[0]


@pytest.mark.parametrize(("num_misplaced", "is_refused"), [(0, False), (5, False), (6, True)])
def test_a_few_misplaced_rows_are_no_reason_to_refuse_a_log(
    geometry: RouteGeometry, num_misplaced: int, is_refused: bool
):
    position_m, lane = np.full(100, 240.0), np.where(np.arange(100) < num_misplaced, 4, 3)
    found = match_lanes(geometry, position_m, np.full(100, np.nan), lane, geometry.edge_at(position_m))
    considered = np.ones(100, bool)
    file, rows = Path("d01_objects.csv"), np.arange(100)
    if is_refused:
        with pytest.raises(CaseError, match='expected 1 to 3, the lanes of edge "a", got 4'):
            refuse_lanes(geometry, file, rows, lane, considered, found)
    else:
        assert refuse_lanes(geometry, file, rows, lane, considered, found) == num_misplaced
    far = match_lanes(geometry, position_m - 150.0, np.full(100, np.nan), lane, geometry.edge_at(position_m - 150.0))
    if num_misplaced:
        with pytest.raises(CaseError):  # nowhere near
            refuse_lanes(geometry, file, rows, lane, considered, far)


def test_in_the_middle_of_a_lane_change_both_numbers_fit(geometry: RouteGeometry):
    for lane, lateral in [(1, 0.5), (2, -0.5)]:
        found = lanes_of(geometry, 100.0, LANE_WIDTH_M, lane)
        assert not found.contradicts[0]
        np.testing.assert_allclose(found.lateral_m, lateral * LANE_WIDTH_M, atol=1e-9)
