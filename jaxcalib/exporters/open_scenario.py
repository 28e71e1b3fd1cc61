"""ASAM OpenSCENARIO XML: every vehicle follows the trajectory that it had in SUMO.

Source: ASAM OpenSCENARIO XML 1.2, model documentation: FollowTrajectoryAction, Polyline, EntityAction, BoundingBox.
The following mode is `position`, which keeps strictly to the trajectory: `follow` leaves it to the player how it gets
from vertex to vertex, and esmini, for one, lets nobody stand still in it (its issue 446). Who enters later is added by
an AddEntityAction and is not in Init, as esmini has it (its test add_delete_entity.xosc).
"""

import itertools
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scenariogeneration import xosc

from jaxcalib.exporters.open_scenario_vehicle import rear_axle_m, vehicle_of
from jaxcalib.exporters.recorded_run import RecordedRun
from jaxcalib.exporters.tracks import Track, read_tracks
from jaxcalib.importers.sumo_fcd import slices_in
from sim_adapters.sumo.open_drive import write_open_drive
from sim_adapters.sumo.trajectories import PRECISION, VehicleKind

EGO = "Ego"  # name of the subject vehicle, which a test engineer replaces
MINOR_VERSION = 2
HEADING_DIGITS = 6  # in rad
AUTHOR = "jaxcalib"
words: Any = xosc  # its annotations name an enumeration where they mean its members
NO_ROAD = "the scenario names no road, for netconvert is not installed: pip install eclipse-sumo, and export again."


def export_open_scenario(recorded: RecordedRun, *, range_m: float | None, has_free_subject: bool) -> list[str]:
    """Write a recorded run's scenario and its road, and return a line about each.

    Args:
        recorded: the run.
        range_m: other vehicles are there while they are so near to the subject vehicle; None for all of them.
        has_free_subject: whether the subject vehicle has no trajectory.

    Raises:
        ScenarioError: netconvert refuses the network.
    """
    file, road = (recorded.folder / f"{recorded.name}.{ending}" for ending in ("xosc", "xodr"))
    has_road = write_open_drive(recorded.problem.scenario.configuration.net_file, road)
    number = write_open_scenario(
        file, read_tracks(slices_in(recorded.fcd)(), recorded.subject, range_m), recorded.vehicles, recorded.subject,
        road=road.name if has_road else None, title=f"Calibrated traffic in SUMO: {recorded.name}",
        has_free_subject=has_free_subject,
    )  # fmt: skip
    line = f"{file}: ASAM OpenSCENARIO XML with {number} vehicles; the subject vehicle '{recorded.subject}' is '{EGO}'."
    return [line, f"{road}: the road, ASAM OpenDRIVE." if has_road else NO_ROAD]


def write_open_scenario(
    file: Path,
    tracks: Sequence[Track],
    vehicles: Mapping[str, VehicleKind],
    subject: str,
    *,
    road: str | None,
    title: str,
    has_free_subject: bool = False,
) -> int:
    """Write a scenario and return how many vehicles it has.

    Time 0 is the subject vehicle's first instant; the scenario ends with the last track. Places have no height, so that
    players put vehicles onto the road.

    Args:
        file: where to; ends in .xosc.
        tracks: of all vehicles, the subject vehicle's first; front bumpers.
        vehicles: what each vehicle is, by id.
        subject: id of the subject vehicle.
        road: file of the road, ASAM OpenDRIVE, as seen from the scenario's folder; None for none.
        title: description in the file's header.
        has_free_subject: whether the subject vehicle is given place and speed at the beginning and nothing further.
    """
    xosc.VersionBase().setVersion(minor=MINOR_VERSION)  # one for all of that package's elements
    stays: dict[str, list[Track]] = {}
    for track in tracks:
        stays.setdefault(track.vehicle, []).append(track)
    names = _names(stays, subject)
    end_s = max(float(track.time_s[-1]) for track in tracks)
    frame = _frame({names[one]: vehicles[one] for one in stays}, road, title, end_s)
    actions = frame.find("Storyboard/Init/Actions")
    act = frame.find("Storyboard/Story/Act")
    assert actions is not None
    assert act is not None
    empty, mark = act[0], ET.Comment("traffic")
    act[0] = mark
    for one, own in stays.items():
        if own[0].time_s[0] == 0.0:
            actions.append(_beginning(names[one], own[0], vehicles[one]))
    ET.indent(frame, " ")
    before, after = ET.tostring(frame, encoding="unicode").split("<!--traffic-->")
    movers = [one for one in stays if not (has_free_subject and one == subject)]
    with file.open("w", encoding="utf-8") as stream:  # vehicle by vehicle: a long run as one tree fills memory
        stream.write(f"<?xml version='1.0' encoding='utf-8'?>\n{before}")
        groups = (_group(names[one], stays[one], vehicles[one], end_s) for one in movers)
        for element in groups if movers else [empty]:
            ET.indent(element, " ")
            stream.write(ET.tostring(element, encoding="unicode") + "\n")
        stream.write(after)
    return len(stays)


def _names(vehicles: Mapping[str, object], subject: str) -> dict[str, str]:
    """Names of the scenario's objects: SUMO's ids, but for the subject vehicle's."""
    others = {one: f"{one}_of_SUMO" if one == EGO else one.lstrip("$") for one in vehicles}  # $ begins a parameter
    return others | {subject: EGO}


def _frame(kinds: Mapping[str, VehicleKind], road: str | None, title: str, end_s: float) -> ET.Element:
    """The scenario, with one group of maneuvers that is empty."""
    entities = xosc.Entities()
    for name, kind in kinds.items():
        entities.add_scenario_object(name, vehicle_of(kind))
    act = xosc.Act("traffic", _at(0.0, "begin"))
    act.add_maneuver_group(xosc.ManeuverGroup("nobody"))
    storyboard = xosc.StoryBoard(xosc.Init(), _at(end_s, "end", "stop"))
    storyboard.add_story(xosc.Story("traffic").add_act(act))
    scenario = xosc.Scenario(
        title, AUTHOR, xosc.ParameterDeclarations(), entities, storyboard, xosc.RoadNetwork(road), xosc.Catalog(),
        osc_minor_version=MINOR_VERSION,
    )  # fmt: skip
    return scenario.get_element()


def _beginning(name: str, track: Track, kind: VehicleKind) -> ET.Element:
    """Place and speed at time 0."""
    private = ET.Element("Private", entityRef=name)
    at_once = xosc.TransitionDynamics(words.DynamicsShapes.step, words.DynamicsDimension.time, 0.0)
    private.append(xosc.TeleportAction(_places(track, kind)[0]).get_element())
    private.append(xosc.AbsoluteSpeedAction(round(float(track.speed_mps[0]), PRECISION), at_once).get_element())
    return private


def _group(name: str, stays: Sequence[Track], kind: VehicleKind, end_s: float) -> ET.Element:
    """A vehicle's maneuvers: it enters, follows its trajectory and leaves, once for each stay."""
    maneuver = xosc.Maneuver(f"{name} drives")
    for number, track in zip(itertools.count(1), stays, strict=False):
        first_s, last_s = float(track.time_s[0]), float(track.time_s[-1])
        places = _places(track, kind)
        drive = xosc.Event(f"{name} follows its trajectory {number}", words.Priority.parallel)
        if first_s > 0.0:
            drive.add_action(f"{name} enters {number}", xosc.AddEntityAction(name, places[0]))
        trajectory = xosc.Trajectory(f"{name} {number}", False)
        trajectory.add_shape(xosc.Polyline(track.time_s.tolist(), places))
        follow = xosc.FollowTrajectoryAction(
            trajectory, words.FollowingMode.position, words.ReferenceContext.absolute, 1.0, 0.0
        )
        drive.add_action(f"{name} drives {number}", follow)
        drive.add_trigger(_at(first_s, f"{name} is there {number}"))
        maneuver.add_event(drive)
        if last_s < end_s:
            leave = xosc.Event(f"{name} leaves {number}", words.Priority.parallel)
            leave.add_action(f"{name} is gone {number}", xosc.DeleteEntityAction(name))
            leave.add_trigger(_at(last_s, f"{name} has arrived {number}"))
            maneuver.add_event(leave)
    group = xosc.ManeuverGroup(name)
    group.add_actor(name)
    group.add_maneuver(maneuver)
    return group.get_element()


def _places(track: Track, kind: VehicleKind) -> list[Any]:
    places = np.round(rear_axle_m(track, kind), PRECISION).tolist()
    headings = np.round(track.heading_rad, HEADING_DIGITS).tolist()
    return [xosc.WorldPosition(x, y, h=heading) for (x, y), heading in zip(places, headings, strict=True)]


def _at(time_s: float, name: str, point: str = "start") -> xosc.ValueTrigger:
    since = xosc.SimulationTimeCondition(time_s, words.Rule.greaterOrEqual)
    return xosc.ValueTrigger(name, 0, words.ConditionEdge.none, since, point)
