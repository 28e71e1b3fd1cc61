"""Which cases to make: what is drawn at random, and from where."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from experiments.blind_effects.effects import EFFECTS, OTHER_MODELS
from experiments.blind_effects.field_spec import DriverType, FieldSpec
from experiments.blind_effects.seal import Label
from experiments.roads.drawn_road import find_road
from experiments.roads.road import BELIEVED_DRIVER, Road

Size = Literal["tiny", "quick", "full"]
LEVELS = ("weak", "medium", "strong")
KINDS = ("single", "pair", "null", "null_far", "out_of_library", "other_model")
CALIBRATED = ("tau", "minGap", "accel", "decel", "speedFactor", "lcSpeedGain", "lcAssertive")
# Relative half-widths. A calibration is expected to find any of these values: they are no effects.
NEAR = dict(zip(CALIBRATED, (0.22, 0.2, 0.2, 0.2, 0.05, 0.2, 0.2), strict=True))
FAR = dict(zip(CALIBRATED, (0.4, 0.4, 0.4, 0.35, 0.1, 0.4, 0.4), strict=True))
NEAR_INPUTS, FAR_INPUTS = 0.06, 0.15
LEAST_FAR = 0.5  # of the half-width: what is called far is far in every value
# Lane-change weights where they are drawn, too, over these values: they may be far from what engineers believe, and
# often no log shows them.
WEIGHTS = {
    "lcStrategic": (0.5, 5.0), "lcSpeedGain": (0.3, 5.0), "lcCooperative": (0.0, 1.0), "lcCooperativeSpeed": (0.0, 1.0),
    "lcKeepRight": (0.0, 1.5),
}  # fmt: skip
MORE_OF_WEIGHTS = ("cooperative_yielding", "keep_right")  # effects that are but other values of these


@dataclass(frozen=True)
class CasePlan:
    """A case to make."""

    name: str  # at random, tells nothing
    road: str  # name of the road
    kind: str  # one of `KINDS`
    effects: tuple[tuple[str, str], ...]  # names and levels
    model: str  # car-following model of the field
    seed: int  # of everything random in it
    draws_weights: bool = False  # whether lane-change weights are drawn over their ranges, and to be calibrated

    @property
    def calibrated(self) -> tuple[str, ...]:
        """Driver parameters that are to be calibrated."""
        more = tuple(name for name in WEIGHTS if name not in CALIBRATED)
        return (*CALIBRATED, *more) if self.draws_weights else CALIBRATED


def plan_cases(
    size: Size, roads: tuple[str, ...], seed: int, kinds: tuple[str, ...] = (), draws_weights: bool = False
) -> list[CasePlan]:
    """Return the cases of a plan in random order; whoever knows the seed knows the labels.

    Tiny are 3 cases, quick is every effect at every level once, full four times, and more of the others.

    Args:
        size: how many.
        roads: names of roads, taken in turn.
        seed: of all that is random.
        kinds: only cases of these kinds; of all unless given.
        draws_weights: whether lane-change weights are drawn over their ranges; more of one is no effect then.
    """
    rng = np.random.default_rng(seed)
    known = [name for name, effect in EFFECTS.items() if not effect.is_outside]
    inside = [name for name in known if not (draws_weights and name in MORE_OF_WEIGHTS)]
    outside = [name for name, effect in EFFECTS.items() if effect.is_outside]
    wanted: list[tuple[str, tuple[tuple[str, str], ...], str]] = []

    def add(kind: str, effects: tuple[tuple[str, str], ...] = (), model: str = "IDM") -> None:
        wanted.append((kind, effects, model))

    if size == "tiny":
        add("single", ((str(rng.choice(inside)), "strong"),))
        add("null")
        add("out_of_library", ((str(rng.choice(outside)), "strong"),))
    else:
        times = 1 if size == "quick" else 4
        for _ in range(times):
            for name in inside:
                for level in LEVELS:
                    add("single", ((name, level),))
            for name in outside:
                for level in LEVELS[1:]:
                    add("out_of_library", ((name, level),))
        for _ in range(10 if size == "quick" else 50):
            add("null")
            add("null_far")
        for _ in range(8 if size == "quick" else 60):
            one, two = rng.choice(inside, 2, replace=False)
            add("pair", ((str(one), "medium"), (str(two), "strong")))
        for model in OTHER_MODELS:
            for _ in range(2 if size == "quick" else 10):
                add("other_model", (), model)
    order = rng.permutation(len(wanted))
    names = [f"{number:08x}" for number in rng.choice(2**32, len(wanted), replace=False)]
    seeds = rng.integers(2**31 - 10_000, size=len(wanted))
    return [
        CasePlan(name, roads[int(at) % len(roads)], *wanted[int(at)], int(case_seed), draws_weights)
        for name, at, case_seed in zip(names, order, seeds, strict=True)
        if not kinds or wanted[at][0] in kinds
    ]


@dataclass(frozen=True)
class DrawnField:
    """A field, and the same without its effects."""

    spec: FieldSpec
    without: FieldSpec  # the same without its effects
    label: Label  # what is true of it


def draw_field(plan: CasePlan) -> DrawnField:
    """Draw what is random in a case."""
    road = find_road(plan.road)
    rng = np.random.default_rng([plan.seed, 3])
    is_far = plan.kind == "null_far"
    theta = {name: _drawn(float(BELIEVED_DRIVER[name]), (FAR if is_far else NEAR)[name], is_far, rng) for name in NEAR}
    width = FAR_INPUTS if is_far else NEAR_INPUTS
    if plan.draws_weights:
        weights = np.random.default_rng([plan.seed, 4])
        theta |= {name: float(weights.uniform(*bounds)) for name, bounds in WEIGHTS.items()}
    inputs = {name: round(_drawn(value, width, is_far, rng), 1) for name, value in road.inputs_vehph.items()}
    attributes = BELIEVED_DRIVER | {name: f"{value:.4f}" for name, value in theta.items()}
    attributes |= OTHER_MODELS.get(plan.model, {})
    without = FieldSpec((DriverType(1.0, attributes),), dict(road.subject), inputs)
    spec, effects, place = _injected(plan, road, without, rng)
    label: Label = {
        "kind": plan.kind,
        "road": plan.road,
        "model": plan.model,
        "theta": {name: round(value, 4) for name, value in theta.items()},
        "inputs": spec.inputs_vehph,
        "effects": effects,
        "place_and_time": place,
    }
    return DrawnField(spec, without, label)


def _drawn(middle: float, width: float, is_far: bool, rng: np.random.Generator) -> float:
    share = rng.uniform(-1.0, 1.0)
    if is_far:
        share = np.sign(share) * (LEAST_FAR + (1.0 - LEAST_FAR) * abs(share))
    return float(middle * (1.0 + width * share))


def _injected(
    plan: CasePlan, road: Road, without: FieldSpec, rng: np.random.Generator
) -> tuple[FieldSpec, list[Label], Label]:
    spec = replace(without)
    effects: list[Label] = []
    places: list[Label] = []
    for name, level in plan.effects:
        effect = EFFECTS[name]
        strength = float(f"{rng.uniform(*effect.strengths[level]):.3g}")
        spec, place = effect.inject(spec, road, strength, rng)
        stated: Label = {"effect": name, "strength": strength, "level": level}
        effects.append(stated | ({"out_of_library": True} if effect.is_outside else {}))
        places.append(place)
    if len(places) < 2:
        return spec, effects, places[0] if places else {}
    by_name = {effect["effect"]: place for effect, place in zip(effects, places, strict=True)}
    return spec, effects, by_name
