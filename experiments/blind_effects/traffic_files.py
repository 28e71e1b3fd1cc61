"""A field, and the scenario that engineers believe in, as files of SUMO."""

from collections.abc import Iterable
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from experiments.blind_effects.field_spec import FieldSpec
from experiments.roads.road import BELIEVED_DRIVER, Flow, Road

SECONDS_PER_HOUR = 3600.0
ENTER = 'departLane="best" departPos="last" departSpeed="avg"'
PLATOON_TIME_GAP_S = 1.4  # between followers in a lane


def _attributes(values: dict[str, str]) -> str:
    return " ".join(f"{name}={quoteattr(value)}" for name, value in values.items())


def _route(flow: Flow) -> str:
    return f'<route id="r_{flow.id}" edges="{" ".join(flow.edges)}"/>'


def scenario_demand(road: Road) -> str:
    """Return the believed scenario's demand.rou.xml."""
    lines = [
        f'<vType id="car" {_attributes(BELIEVED_DRIVER)}/>',
        f'<vType id="subject" {_attributes(road.subject)}/>',
        f'<route id="r_ego" edges="{" ".join(road.ego_edges)}"/>',
        *(_route(flow) for flow in road.flows),
    ]
    for flow in road.flows:
        rate_vehps = flow.share * road.inputs_vehph[flow.entrance] / SECONDS_PER_HOUR
        lines.append(
            f'<flow id="{flow.id}" type="car" route="r_{flow.id}" begin="0" end="{road.duration_s:g}" '
            f'period="exp({rate_vehps:.6f})" {ENTER}/>'
        )
    lines.append(f'<vehicle id="ego" type="subject" route="r_ego" depart="{road.warmup_s:g}" {ENTER}/>')
    return "<routes>\n    " + "\n    ".join(lines) + "\n</routes>\n"


def scenario_config(road: Road) -> str:
    """Return the believed scenario's scenario.sumocfg."""
    return (
        '<configuration>\n    <input><net-file value="net.net.xml"/><route-files value="demand.rou.xml"/></input>\n'
        f'    <time><begin value="0"/><end value="{road.duration_s:g}"/><step-length value="0.1"/></time>\n'
        '    <processing><time-to-teleport value="-1"/><collision.action value="warn"/></processing>\n'
        "</configuration>\n"
    )


def arrivals_s(spec: FieldSpec, road: Road, flow: Flow, rng: np.random.Generator) -> list[float]:
    """Return times at which the vehicles of a flow arrive: Poisson, thinned for a surge, some in platoons."""
    mean_vehps = flow.share * spec.inputs_vehph[flow.entrance] / SECONDS_PER_HOUR
    most_vehps = mean_vehps * (1.0 + 0.5 * abs(spec.surge))
    times = np.sort(rng.uniform(0.0, road.duration_s, rng.poisson(most_vehps * road.duration_s)))
    slope = spec.surge * (times / road.duration_s - 0.5)
    times = times[rng.uniform(size=len(times)) * most_vehps < mean_vehps * (1.0 + slope)]
    if spec.platoon_share > 0.0 and flow.entrance == road.flows[0].entrance:
        times = _bunched(times, spec, road, rng)
    return [round(float(time_s), 1) for time_s in times]


def _bunched(times: np.ndarray, spec: FieldSpec, road: Road, rng: np.random.Generator) -> np.ndarray:
    """Return the arrivals with a share of them moved into platoons, as many as before."""
    lanes = len(road.lanes_of(road.ego_edges[0]))
    joins = rng.uniform(size=len(times)) < spec.platoon_share
    members = np.flatnonzero(joins)
    moved = times.copy()
    at = 0
    while at < len(members):
        size = int(rng.geometric(1.0 / spec.platoon_size))
        platoon = members[at : at + size]
        begin_s = times[platoon].mean() - 0.5 * len(platoon) * PLATOON_TIME_GAP_S / lanes
        moved[platoon] = begin_s + PLATOON_TIME_GAP_S / lanes * np.arange(len(platoon))
        at += size
    return np.sort(np.clip(moved, 0.0, road.duration_s - 0.1))


def field_demand(spec: FieldSpec, road: Road, seed: int, depart_s: float) -> str:
    """Return demand.rou.xml of one drive in the field: every vehicle for itself."""
    rng = np.random.default_rng([seed, 11])
    lines = []
    for number, driver in enumerate(spec.drivers):
        parameters = "".join(f'<param key="{key}" value="{value}"/>' for key, value in driver.parameters.items())
        lines.append(f'<vType id="t{number}" {_attributes(driver.attributes)}>{parameters}</vType>')
    lines.append(f'<vType id="subject" {_attributes(spec.subject)}/>')
    lines.append(f'<route id="r_ego" edges="{" ".join(road.ego_edges)}"/>')
    lines += [_route(flow) for flow in road.flows]
    vehicles: list[tuple[float, str]] = []
    for flow in road.flows:
        times = arrivals_s(spec, road, flow, rng)
        shares = np.asarray(
            [driver.share * (flow.entrance in (driver.entrances or (flow.entrance,))) for driver in spec.drivers]
        )
        kinds = rng.choice(len(shares), size=len(times), p=shares / shares.sum())
        for count, (time_s, kind) in enumerate(zip(times, kinds, strict=True)):
            what = f'id="{flow.id}.{count}" type="t{kind}" route="r_{flow.id}" depart="{time_s:g}"'
            vehicles.append((time_s, f"<vehicle {what} {ENTER}/>"))
    for number, vehicle in enumerate(spec.standing):
        stop = (
            f'<stop lane="{vehicle.lane}" startPos="{vehicle.position_m - 10.0:g}" endPos="{vehicle.position_m:g}" '
            f'until="{vehicle.until_s:g}"/>'
        )
        head = f'<vehicle id="standing.{number}" type="t0" route="r_ego" depart="{vehicle.depart_s:g}" {ENTER}>'
        vehicles.append((vehicle.depart_s, f"{head}{stop}</vehicle>"))
    vehicles.append((depart_s, f'<vehicle id="ego" type="subject" route="r_ego" depart="{depart_s:g}" {ENTER}/>'))
    lines += [text for _, text in sorted(vehicles, key=lambda pair: pair[0])]
    return "<routes>\n" + "\n".join(lines) + "\n</routes>\n"


def additional_file(spec: FieldSpec) -> str:
    """Return the file with variable speed signs."""
    signs = []
    for number, sign in enumerate(spec.speed_signs):
        steps = f'<step time="{sign.from_s:g}" speed="{sign.speed_mps:.3f}"/>'
        steps += f'<step time="{sign.to_s:g}" speed="-1"/>' if sign.to_s is not None else ""
        signs.append(f'<variableSpeedSign id="v{number}" lanes="{" ".join(sign.lanes)}">{steps}</variableSpeedSign>')
    return "<additional>\n" + "\n".join(signs) + "\n</additional>\n"


def write_files(folder: Path, texts: Iterable[tuple[str, str]]) -> None:
    """Write texts into a folder that is made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts:
        (folder / name).write_text(text, encoding="utf-8")
