"""Unmodelled effects by SUMO's own means: vType attributes, vType distributions, options, lists of departures.

SUMO runs by itself: nothing is told a vehicle on the way, since that alone would change its accelerations. An effect
that other attributes of vTypes express says so itself (`Effect.vtype_attributes`); what needs more has an entry in
`EXPRESSIONS`. Effects with neither SUMO has no means for; effects of a sensor act on frames, whoever made them
(`surrogate.effects`). Models and units are those of `surrogate/effects/`.
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from sim_adapters.scenario.effect_draft import Draft
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.scenario.sumo_names import habit_attributes
from sim_adapters.scenario.unscaled_subject import subject_vtypes
from surrogate.effects.base import Effect, EffectSetting
from surrogate.effects.driver_heterogeneity import SPEED_SHARE
from surrogate.effects.heavy_vehicles import (
    ACCELERATION_FACTOR,
    DECELERATION_FACTOR,
    LENGTH_M,
    TIME_GAP_FACTOR,
    TOP_SPEED_MPS,
)
from surrogate.effects.memory import MEMORY
from surrogate.effects.platooned_arrivals import HEADWAY_S, REGULAR_SHARE, SIZE
from surrogate.effects.registry import EFFECTS, effect_named
from surrogate.effects.slow_start import BEGINS_BELOW_MPS, ENDS_ABOVE_MPS

NUM_TYPES = 40  # of drivers who differ


class NotExpressibleError(ValueError):
    """SUMO has no means for an effect, or not with this scenario's drivers."""


@dataclass(frozen=True)
class Expression:
    """SUMO's means for an effect.

    Attributes:
        put: puts it into a draft.
        car_following: models of the background's drivers with which SUMO has it; None for all.
    """

    put: Callable[[Draft, EffectSetting], None]
    car_following: tuple[str, ...] | None = None


def put_into(draft: Draft, effects: Mapping[str, EffectSetting]) -> None:
    """Put effects into a scenario.

    Raises:
        NotExpressibleError: SUMO has no means for one of them.
    """
    for name, setting in effects.items():
        expression = expression_of(effect_named(name))
        if expression is None:
            known = ", ".join(effect.name for effect in EFFECTS if expression_of(effect) is not None)
            raise NotExpressibleError(f"SUMO has no means for '{name}'; it has for {known}.")
        if setting.strength == 0.0:
            continue
        models = expression.car_following
        if models is not None and not _drivers_follow(draft.scenario, models):
            raise NotExpressibleError(f"SUMO has means for '{name}' with {', '.join(models)} only.")
        # numbers of NumPy are written in a way that SUMO does not read
        expression.put(draft, replace(setting, strength=float(setting.strength)))


def is_expressible(scenario: Scenario, name: str) -> bool:
    """Whether SUMO has means for an effect with the drivers of a scenario."""
    expression = expression_of(effect_named(name))
    if expression is None:
        return False
    return expression.car_following is None or _drivers_follow(scenario, expression.car_following)


def expression_of(effect: Effect) -> Expression | None:
    """SUMO's means for an effect; None where it has none."""
    if effect.name in EXPRESSIONS:
        return EXPRESSIONS[effect.name]
    if not effect.vtype_attributes:
        return None

    def put(draft: Draft, setting: EffectSetting) -> None:
        for vtype in draft.vtypes(draft.background):
            for attribute, change in effect.vtype_attributes:
                vtype.set(attribute, repr(float(change(draft.number(vtype, attribute), setting.strength))))

    return Expression(put)


def _drivers_follow(scenario: Scenario, models: Sequence[str]) -> bool:
    return all(scenario.model_of(flow.vtype) in models for flow in scenario.flows)


def _act_at_intervals(draft: Draft, names: Sequence[str], interval_s: float) -> None:
    step_s = draft.scenario.configuration.step_s
    for vtype in draft.vtypes(names):
        vtype.set("actionStepLength", f"{max(1, round(interval_s / step_s)) * step_s:.6g}")


def _reaction_delay(draft: Draft, setting: EffectSetting) -> None:
    _act_at_intervals(draft, draft.background, setting.strength)


def _subject_actuation_lag(draft: Draft, setting: EffectSetting) -> None:
    _act_at_intervals(draft, subject_vtypes(draft.scenario), setting.strength)


def _acceleration_noise(draft: Draft, setting: EffectSetting) -> None:
    for vtype in draft.vtypes(draft.background):
        ET.SubElement(vtype, "param", key="has.driverstate.device", value="true")
        awareness = repr(1.0 - setting.strength)
        ET.SubElement(vtype, "param", key="device.driverstate.initialAwareness", value=awareness)


def _driver_heterogeneity(draft: Draft, setting: EffectSetting) -> None:
    random = np.random.default_rng(draft.seed)
    for vtype in draft.vtypes(draft.background):
        names = habit_attributes(draft.scenario.model_of(vtype.get("id", "")))
        spreads = dict.fromkeys(names, setting.strength) | {"speedFactor": SPEED_SHARE * setting.strength}
        parts = []
        for _ in range(NUM_TYPES):
            part = deepcopy(vtype)
            for attribute, spread in spreads.items():
                sigma = np.sqrt(np.log1p(spread**2))
                factor = float(np.exp(sigma * random.standard_normal() - 0.5 * sigma**2))
                _scale(part, attribute, factor * draft.number(vtype, attribute))
            parts.append((1.0 / NUM_TYPES, part))
        draft.divide(vtype, parts)


def _memory(draft: Draft, setting: EffectSetting) -> None:
    given_s = setting.time_constant_s
    adapt_s = MEMORY.default_time_constant_s if given_s is None else given_s
    for vtype in draft.vtypes(draft.background):
        vtype.set("carFollowModel", "IDMM")
        vtype.set("adaptFactor", repr(1.0 + setting.strength))
        vtype.set("adaptTime", repr(adapt_s))


def _slow_start(draft: Draft, setting: EffectSetting) -> None:
    """Full acceleration from a speed on only; unlike the surrogate's, drivers who never stopped are slow there, too."""
    for vtype in draft.vtypes(draft.background):
        full = draft.number(vtype, "accel")
        low = (1.0 - setting.strength) * full
        vtype.set("speedTable", f"0 {BEGINS_BELOW_MPS:g} {ENDS_ABOVE_MPS:g} {draft.number(vtype, 'maxSpeed'):g}")
        for profile in ("maxAccelProfile", "desAccelProfile"):
            vtype.set(profile, f"{low!r} {low!r} {full!r} {full!r}")


def _lane_change_duration(draft: Draft, setting: EffectSetting) -> None:
    draft.processing["lanechange.duration"] = repr(setting.strength)


def _heavy_vehicles(draft: Draft, setting: EffectSetting) -> None:
    factors = (TIME_GAP_FACTOR, ACCELERATION_FACTOR, DECELERATION_FACTOR)
    for vtype in draft.vtypes(draft.background):
        lorry = deepcopy(vtype)
        lorry.set("length", repr(LENGTH_M))
        lorry.set("maxSpeed", repr(min(TOP_SPEED_MPS, draft.number(vtype, "maxSpeed"))))
        habits = habit_attributes(draft.scenario.model_of(vtype.get("id", "")))
        for attribute, factor in zip(habits, factors, strict=True):
            lorry.set(attribute, repr(factor * draft.number(vtype, attribute)))
        draft.divide(vtype, [(1.0 - setting.strength, deepcopy(vtype)), (setting.strength, lorry)])


def _platooned_arrivals(draft: Draft, setting: EffectSetting) -> None:
    """Departures of the mainline as a list: blocks of vehicles, each a platoon or not, at the same mean flow.

    The surrogate's model: the first vehicle of a platoon waits for what the others save.
    """
    demand = draft.scenario.demand
    entrance = demand.subject_route[0]
    flows = {flow.id: flow for flow in draft.scenario.flows if flow.route[0] == entrance}
    elements = {one.get("id", ""): one for one in draft.elements if one.tag == "flow" and one.get("id") in flows}
    rates = np.asarray([draft.rates_vehps[name] for name in elements])
    num_lanes = len(draft.scenario.network.edge_lanes(entrance))
    random = np.random.default_rng(draft.seed)
    total, within_s = rates.sum(), HEADWAY_S / num_lanes
    within = min(1.0, within_s * total)
    begin_s = min(flow.begin_s for flow in flows.values())
    end_s = min(max(flow.end_s for flow in flows.values()), draft.scenario.end_s)  # files say a million seconds, too
    departures, time_s = [], begin_s
    while time_s < end_s:
        is_platoon = random.random() < setting.strength
        gaps = random.exponential(size=SIZE)
        if is_platoon:
            gaps[0] *= SIZE - (SIZE - 1) * within
            gaps[1:] = within * (REGULAR_SHARE + (1.0 - REGULAR_SHARE) * gaps[1:])
        for gap in gaps:
            time_s += gap / total
            departures.append(time_s)
    names = list(elements)
    numbers = dict.fromkeys(names, 0)
    vehicles = []
    for depart_s in departures:
        name = names[random.choice(len(names), p=rates / total)]
        if not flows[name].begin_s <= depart_s < flows[name].end_s:
            continue
        vehicle = ET.Element("vehicle", id=f"{name}.{numbers[name]}", depart=f"{depart_s:.3f}")
        for attribute in ("type", "route", "departLane", "departPos", "departSpeed"):
            if attribute in elements[name].attrib:
                vehicle.set(attribute, elements[name].get(attribute, ""))
        vehicle.tail = "\n"
        numbers[name] += 1
        vehicles.append(vehicle)
    replaced = list(elements.values())
    others = [one for one in draft.elements if one.tag not in ("vehicle", "trip") and one not in replaced]
    vehicles += [one for one in draft.elements if one.tag in ("vehicle", "trip")]
    draft.elements[:] = [*others, *vehicles]


def _scale(vtype: ET.Element, attribute: str, value: float) -> None:
    """Set an attribute; of a bounded desired speed the mean."""
    old = vtype.get(attribute, "").replace(" ", "")
    if attribute == "speedFactor" and old.startswith("normc("):
        vtype.set(attribute, f"normc({value!r},{old.partition(',')[2]}")
    else:
        vtype.set(attribute, repr(value))


EXPRESSIONS: dict[str, Expression] = {
    "reaction_delay": Expression(_reaction_delay),
    "acceleration_noise": Expression(_acceleration_noise),
    "driver_heterogeneity": Expression(_driver_heterogeneity),
    "memory": Expression(_memory, car_following=("IDM",)),  # IDMM
    "slow_start": Expression(_slow_start),
    "lane_change_duration": Expression(_lane_change_duration),
    "heavy_vehicles": Expression(_heavy_vehicles),
    "platooned_arrivals": Expression(_platooned_arrivals),
    "subject_actuation_lag": Expression(_subject_actuation_lag),
}
