"""The effects, each put into a field by means that SUMO has itself, or into the log after the run.

Strengths have the units of the effect library's documentation. Three effects of that library have no means in SUMO that
leave the vehicles to SUMO: multi_anticipation, lane_change_relaxation and grade (IDM ignores slopes).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from experiments.blind_effects.field_spec import (
    DriverType,
    FieldSpec,
    SpeedSign,
    StandingVehicle,
)
from experiments.roads.road import Road

Place = dict[str, float | int | str]
Injected = tuple[FieldSpec, Place]
Inject = Callable[[FieldSpec, Road, float, np.random.Generator], Injected]
SPREAD_SIGMAS = 2.5
NUM_TYPES = 40
CARS_PER_SPEED_FACTOR = 0.35
RUBBERNECK_LOSS = 0.35


@dataclass(frozen=True)
class FieldEffect:
    """An effect."""

    name: str  # of the effect library, or of its own
    strengths: dict[str, tuple[float, float]]  # least and most of weak, medium and strong
    inject: Inject  # puts it into a field and returns its place, time and whatever else is true
    is_outside: bool = False  # no effect of the library


def _levels(weak: tuple, medium: tuple, strong: tuple) -> dict[str, tuple[float, float]]:
    return {"weak": weak, "medium": medium, "strong": strong}


def _drivers(**attributes: Callable[[float], str]) -> Inject:
    """Return an injection that sets attributes of every background driver."""

    def inject(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
        del road, rng
        return spec.with_all_drivers({name: make(strength) for name, make in attributes.items()}), {}

    return inject


def _delay(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    del road, rng
    return spec.with_all_drivers({"actionStepLength": f"{_tenths(strength):.1f}"}), {}


def _tenths(strength: float) -> float:
    return max(0.2, round(strength, 1))


def _perception_errors(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    del road, rng
    awareness = f"{1.0 - strength:.3f}"
    parameters = {
        "has.driverstate.device": "true",
        "device.driverstate.initialAwareness": awareness,
        "device.driverstate.minAwareness": "0.05",
    }
    return spec.with_all_drivers({}, parameters), {}


def _heterogeneity(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    del road
    drivers = []
    for base in spec.drivers:
        for _ in range(NUM_TYPES):
            own = dict(base.attributes)
            for name, spread in (
                ("tau", strength),
                ("accel", strength),
                ("decel", strength),
                ("speedFactor", CARS_PER_SPEED_FACTOR * strength),
            ):
                sigma = np.sqrt(np.log1p(spread**2))
                factor = np.exp(sigma * np.clip(rng.standard_normal(), -SPREAD_SIGMAS, SPREAD_SIGMAS) - 0.5 * sigma**2)
                own[name] = f"{float(own[name]) * factor:.4f}"
            drivers.append(DriverType(base.share / NUM_TYPES, own, base.parameters))
    return replace(spec, drivers=tuple(drivers)), {}


def _memory(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    del road, rng
    return spec.with_all_drivers({"carFollowModel": "IDMM", "adaptFactor": f"{strength:.3f}", "adaptTime": "60"}), {}


def _slow_start(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    del road, rng
    changed = []
    for driver in spec.drivers:
        full = float(driver.attributes["accel"])
        low = full * (1.0 - strength)
        profile = f"{low:.3f} {low:.3f} {full:.3f} {full:.3f}"
        own = {"speedTable": "0 8 14 60", "maxAccelProfile": profile, "desAccelProfile": profile}
        changed.append(replace(driver, attributes=driver.attributes | own))
    return replace(spec, drivers=tuple(changed)), {}


def _yielding(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    del road, rng
    old = spec.drivers[0].attributes
    values = {name: f"{min(1.0, float(old[name]) + strength):.3f}" for name in ("lcCooperative", "lcCooperativeSpeed")}
    return spec.with_all_drivers(values), {}


def _change_duration(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    del road, rng
    return replace(spec, options=(*spec.options, "--lanechange.duration", f"{strength:.2f}")), {}


def _heavy_vehicles(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    del road, rng
    heavy = []
    for driver in spec.drivers:
        own = dict(driver.attributes)
        own |= {"vClass": "truck", "length": "13.5", "maxSpeed": f"{85.0 / 3.6:.2f}"}
        own["accel"] = f"{0.6 * float(own['accel']):.3f}"
        own["decel"] = f"{0.9 * float(own['decel']):.3f}"
        own["tau"] = f"{1.2 * float(own['tau']):.3f}"
        heavy.append(DriverType(driver.share * strength, own, driver.parameters))
    cars = [replace(driver, share=driver.share * (1.0 - strength)) for driver in spec.drivers]
    return replace(spec, drivers=(*cars, *heavy)), {}


def _platoons(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    del road, rng
    return replace(spec, platoon_share=strength), {}


def _ramp_inflow(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    """Scale the ramp's true inflow away from the scenario's, whatever it was."""
    ramp = list(road.inputs_vehph)[-1]
    sign = 1 if rng.uniform() < 0.5 else -1
    inputs = spec.inputs_vehph | {ramp: road.inputs_vehph[ramp] * (1.0 + sign * strength)}
    return replace(spec, inputs_vehph=inputs), {"input": ramp, "sign": sign}


def _edge(road: Road, rng: np.random.Generator) -> str:
    return str(rng.choice(road.local_edges))


def _times_s(road: Road, length_s: float, rng: np.random.Generator) -> tuple[float, float]:
    first_s = road.warmup_s + 30.0
    begin_s = round(float(rng.uniform(first_s, first_s + 80.0)))
    return begin_s, begin_s + round(length_s)


def _place(road: Road, edge: str) -> Place:
    begin_m, end_m = road.place_m(edge)
    return {"route_from_m": begin_m, "route_to_m": end_m}


def _local_limit(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    """Show a lower limit on one edge; the log goes on to state the limit that the scenario has."""
    edge = _edge(road, rng)
    sign = SpeedSign(road.lanes_of(edge), (1.0 - strength) * road.limit_mps(edge))
    return replace(spec, speed_signs=(*spec.speed_signs, sign)), _place(road, edge)


def _blockage(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    edge = _edge(road, rng)
    begin_s, end_s = _times_s(road, strength, rng)
    lanes = road.lanes_of(edge)
    index = int(rng.integers(len(lanes)))
    at_m = round(float(rng.uniform(0.4, 0.8)) * road.net.getEdge(edge).getLength(), 1)
    begin_m = road.place_m(edge)[0] + at_m
    travel_s = (begin_m + 100.0) / (0.85 * road.limit_mps(edge))
    standing = StandingVehicle(lanes[index], at_m, max(0.0, begin_s - travel_s), end_s)
    place: Place = {"route_from_m": begin_m, "route_to_m": begin_m, "time_from_s": begin_s, "time_to_s": end_s}
    place["lane_from_left"] = len(lanes) - index
    return replace(spec, standing=(*spec.standing, standing)), place


def _rubbernecking(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    """Show a limit lowered by 35 % for a time; who does not care makes up for it by his speed factor.

    His `maxSpeed` is what he wants to drive, so he drives elsewhere as ever. The place is upstream of the on-ramp,
    where all vehicles come from the first entrance.
    """
    edge = str(rng.choice(road.edges_before_ramp))
    begin_s, end_s = _times_s(road, rng.uniform(100.0, 160.0), rng)
    main = road.flows[0].entrance
    others = tuple(name for name in road.inputs_vehph if name != main)
    drivers: list[DriverType] = []
    for driver in spec.drivers:
        drivers += [
            replace(driver, share=driver.share * strength, entrances=(main,)),
            replace(driver, entrances=others),
        ]
        factor, spread = float(driver.attributes["speedFactor"]), float(driver.attributes["speedDev"])
        for _ in range(NUM_TYPES):
            wanted = max(0.5, factor + spread * float(np.clip(rng.standard_normal(), -SPREAD_SIGMAS, SPREAD_SIGMAS)))
            own = driver.attributes | {"speedFactor": f"{wanted / (1.0 - RUBBERNECK_LOSS):.4f}", "speedDev": "0"}
            own["maxSpeed"] = f"{wanted * road.limit_mps(edge):.3f}"
            share = driver.share * (1.0 - strength) / NUM_TYPES
            drivers.append(DriverType(share, own, driver.parameters, (main,)))
    sign = SpeedSign(road.lanes_of(edge), (1.0 - RUBBERNECK_LOSS) * road.limit_mps(edge), begin_s, end_s)
    subject = spec.subject | {"speedFactor": f"{1.0 / (1.0 - RUBBERNECK_LOSS):.4f}"}
    spec = replace(spec, drivers=tuple(drivers), speed_signs=(*spec.speed_signs, sign), subject=subject)
    return spec, _place(road, edge) | {"time_from_s": begin_s, "time_to_s": end_s}


def _sensor(name: str, *, either_sign: bool = False) -> Inject:
    def inject(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
        del road
        sign = -1 if either_sign and rng.uniform() < 0.5 else 1
        sensor = replace(spec.sensor, **{name: sign * strength})
        return replace(spec, sensor=sensor), {"sign": sign} if either_sign else {}

    return inject


def _actuation(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    del road, rng
    return replace(spec, subject=spec.subject | {"actionStepLength": f"{_tenths(strength):.1f}"}), {}


def _one_lane_limit(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    """Show a lower limit in the leftmost or rightmost lane, everywhere."""
    side = -1 if rng.uniform() < 0.5 else 0
    names = road.ego_edges[1:]
    lanes = tuple(road.lanes_of(name)[side] for name in names)
    sign = SpeedSign(lanes, (1.0 - strength) * road.limit_mps(names[0]))
    return replace(spec, speed_signs=(*spec.speed_signs, sign)), {"lane": "left" if side else "right"}


def _some_drivers(share: float, **change: Callable[[float, float], float]) -> Inject:
    """Return an injection by which a share of the drivers differs from all the others."""

    def inject(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
        del road, rng
        some = []
        for driver in spec.drivers:
            own = dict(driver.attributes)
            for name, make in change.items():
                own[name] = f"{make(float(own[name]), strength):.3f}"
            some.append(DriverType(driver.share * share, own, driver.parameters))
        rest = [replace(driver, share=driver.share * (1.0 - share)) for driver in spec.drivers]
        return replace(spec, drivers=(*rest, *some)), {"share": share}

    return inject


def _surge(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    del road
    sign = 1 if rng.uniform() < 0.5 else -1
    return replace(spec, surge=sign * strength), {"sign": sign}


def _spillback(spec: FieldSpec, road: Road, strength: float, rng: np.random.Generator) -> Injected:
    """Let traffic crawl at the very end of the road: a queue grows from there."""
    del rng
    edge = road.ego_edges[-1]
    sign = SpeedSign(road.lanes_of(edge), (1.0 - strength) * road.limit_mps(edge), road.warmup_s)
    return replace(spec, speed_signs=(*spec.speed_signs, sign)), _place(road, edge) | {"time_from_s": road.warmup_s}


_IN_LIBRARY = (
    FieldEffect("reaction_delay", _levels((0.4, 0.6), (0.8, 1.1), (1.3, 1.6)), _delay),
    FieldEffect("acceleration_noise", _levels((0.25, 0.4), (0.45, 0.6), (0.7, 0.85)), _perception_errors),
    FieldEffect("driver_heterogeneity", _levels((0.08, 0.12), (0.17, 0.24), (0.3, 0.4)), _heterogeneity),
    FieldEffect("memory", _levels((1.15, 1.3), (1.4, 1.6), (1.7, 2.0)), _memory),
    FieldEffect("slow_start", _levels((0.15, 0.25), (0.3, 0.4), (0.45, 0.6)), _slow_start),
    FieldEffect("cooperative_yielding", _levels((0.15, 0.25), (0.35, 0.45), (0.55, 0.7)), _yielding),
    FieldEffect("lane_change_duration", _levels((1.5, 2.2), (3.5, 4.5), (5.5, 6.5)), _change_duration),
    FieldEffect(
        "keep_right", _levels((0.8, 1.2), (2.5, 3.5), (4.5, 6.0)), _drivers(lcKeepRight=lambda s: f"{0.1 + s:.2f}")
    ),
    FieldEffect("local_speed_reduction", _levels((0.07, 0.1), (0.13, 0.18), (0.22, 0.3)), _local_limit),
    FieldEffect("heavy_vehicles", _levels((0.04, 0.07), (0.1, 0.14), (0.2, 0.28)), _heavy_vehicles),
    FieldEffect("platooned_arrivals", _levels((0.15, 0.25), (0.35, 0.45), (0.55, 0.7)), _platoons),
    FieldEffect("ramp_inflow_error", _levels((0.12, 0.18), (0.25, 0.35), (0.5, 0.65)), _ramp_inflow),
    FieldEffect("blockage", _levels((30, 50), (80, 100), (140, 180)), _blockage),
    FieldEffect("rubbernecking", _levels((0.15, 0.25), (0.35, 0.45), (0.6, 0.8)), _rubbernecking),
    FieldEffect(
        "gap_sensor_bias", _levels((0.015, 0.025), (0.04, 0.06), (0.1, 0.14)), _sensor("bias", either_sign=True)
    ),
    FieldEffect("sensor_noise", _levels((0.08, 0.12), (0.25, 0.35), (0.7, 0.9)), _sensor("noise")),
    FieldEffect("sensor_latency", _levels((0.15, 0.25), (0.35, 0.45), (0.6, 0.8)), _sensor("latency_s")),
    FieldEffect("sensor_range", _levels((0.15, 0.25), (0.35, 0.45), (0.55, 0.65)), _sensor("range_loss")),
    FieldEffect("subject_actuation_lag", _levels((0.3, 0.4), (0.5, 0.7), (0.9, 1.1)), _actuation),
)
_OUTSIDE = (
    FieldEffect("lane_speed_limit", _levels((0.12, 0.16), (0.2, 0.25), (0.3, 0.4)), _one_lane_limit, True),
    FieldEffect(
        "tailgaters",
        _levels((0.3, 0.4), (0.45, 0.55), (0.6, 0.7)),
        _some_drivers(0.2, tau=lambda v, s: v * (1 - s)),
        True,
    ),
    FieldEffect(
        "weavers",
        _levels((1.0, 2.0), (3.0, 5.0), (8.0, 12.0)),
        _some_drivers(0.15, lcSpeedGain=lambda v, s: v * (1 + s), lcAssertive=lambda v, s: v * (1 + 0.3 * s)),
        True,
    ),
    FieldEffect("demand_surge", _levels((0.3, 0.4), (0.6, 0.8), (1.1, 1.4)), _surge, True),
    FieldEffect("downstream_queue", _levels((0.5, 0.55), (0.6, 0.65), (0.7, 0.75)), _spillback, True),
    FieldEffect("id_swaps", _levels((1.0, 2.0), (4.0, 6.0), (12.0, 20.0)), _sensor("swaps_per_min"), True),
    FieldEffect("clock_drift", _levels((0.001, 0.002), (0.004, 0.006), (0.012, 0.02)), _sensor("clock_drift"), True),
    FieldEffect(
        "map_offset", _levels((8.0, 12.0), (20.0, 30.0), (45.0, 60.0)), _sensor("map_offset_m", either_sign=True), True
    ),
)
EFFECTS: dict[str, FieldEffect] = {effect.name: effect for effect in (*_IN_LIBRARY, *_OUTSIDE)}
OTHER_MODELS: dict[str, dict[str, str]] = {
    "Krauss": {"carFollowModel": "Krauss", "sigma": "0.3"},
    "EIDM": {"carFollowModel": "EIDM"},
    "W99": {"carFollowModel": "W99", "cc1": "1.1", "cc2": "6.0"},
    "ACC": {"carFollowModel": "ACC"},
}
