"""Turns a scenario and a parameter vector into the surrogate's `World`; works on traced values."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sim_adapters.errors import ScenarioError
from sim_adapters.interface import NO_DRIVE, ParameterLayout
from sim_adapters.scenario.demand_file import VEHICLES
from sim_adapters.scenario.road_builder import build_road
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.scenario.sumo_names import vehicle_class, with_attribute
from sim_adapters.units import SECONDS_PER_HOUR
from sim_adapters.world.distant_vtypes import check_distant_vtypes
from sim_adapters.world.logged_drive import LoggedDrive, logged_motion_of
from sim_adapters.world.queues import MOST_DEMAND, entrance_tables, is_plain, queues_of, rules_of, schedule_of
from sim_adapters.world.recorded_parts import RecordedParts, are_whole, parts_table
from surrogate.effects.apply import NUM_CLASSES_OF_EFFECTS, classes_with_effects, true_inputs
from surrogate.effects.settings import Effects
from surrogate.inflow.departure import DepartureRules
from surrogate.inflow.inflow import Inflow, SubjectPlan
from surrogate.inflow.timetable import Schedule, Timetable, timetable
from surrogate.loop.distant import DistantDrivers, distant_class
from surrogate.loop.world import World
from surrogate.road.road import Road
from surrogate.subject.logged_drive import LoggedMotion
from surrogate.subject.planner import Planner
from surrogate.subject.registry import REPLAY, SubjectModel
from surrogate.vehicle.vehicle_class import VehicleClass

SMALLEST_FLOW_VEHPS = 1e-9


@dataclass(frozen=True)
class WorldTemplate:
    """What all worlds of one scenario share.

    Where `schedule` is given, what is called an entrance here is one of the queues before it.
    """

    layout: ParameterLayout  # meaning of parameter vectors
    road: Road  # geometry
    lane_row: np.ndarray  # rows of each entrance's lanes
    serves: np.ndarray  # which lanes of an entrance serve a destination
    edge_m: np.ndarray  # begin and end of each entrance's edge
    window_s: np.ndarray  # begin and end of each entrance's flows
    is_regular: np.ndarray  # whether vehicles come evenly
    flow_rate_vehps: np.ndarray  # rate of each flow as the scenario has it, [entrance, flow]; 0 where there is none
    input_vehps: np.ndarray  # demand of each input as the scenario has it, in the mean over the time in which it comes
    flow_input: np.ndarray  # input that scales each flow; the number of inputs where none does
    flow_destination: np.ndarray  # destination of each flow
    flow_class: np.ndarray  # class of each flow
    # vTypes in the order of the classes: of the flows, of distant vehicles, of the subject vehicle
    class_names: tuple[str, ...]
    class_models: tuple[str, ...]  # their car-following models
    class_values: tuple[dict[str, float], ...]  # their attributes
    subject_entrance: int  # entrance of the subject vehicle
    subject_destination: int
    subject_model: SubjectModel = field(default_factory=SubjectModel)  # who drives it
    sensor_range_m: tuple[float, float] = (150.0, 150.0)  # how far it sees ahead and behind; its planner knows no more
    # the drives that it repeats, if it does; put in with `dataclasses.replace`
    logged_drives: tuple[LoggedDrive, ...] = ()
    # what each drive's log covers, where one covers less than the route: there alone runs are observed
    recorded: tuple[RecordedParts, ...] = ()
    # vType as which each of these vTypes follows beyond the sensors' range
    distant_vtypes: Mapping[str, str] = field(default_factory=dict)
    # what may arrive, where entrances know more than one window of time or ways to depart; else None
    schedule: Schedule | None = None
    rules: DepartureRules | None = None  # how vehicles depart; given with a schedule
    entrance_of_queue: np.ndarray | None = None  # entrance before which each queue waits; given with a schedule
    vehicle_scale: float = 1.0  # SUMO's factor on single vehicles

    @property
    def can_share_runs(self) -> bool:
        """Whether several subject vehicles may drive in one run: where all vehicles follow their vTypes' models."""
        return not self.subject_model.is_controlled and not self.distant_vtypes

    def of_entrances(self, counts: np.ndarray) -> np.ndarray:
        """Return what was counted at each entrance, from what was at each queue."""
        if self.entrance_of_queue is None:
            return counts
        summed = np.zeros(self.entrance_of_queue.max() + 1, counts.dtype)
        np.add.at(summed, self.entrance_of_queue, counts)
        return summed

    def base_demand_vehph(self) -> np.ndarray:
        """Return the demand of each input as the scenario has it."""
        return self.input_vehps * SECONDS_PER_HOUR

    @property
    def most_demand_vehph(self) -> np.ndarray:
        """Demand of each input beyond which vehicles would be missing; inf where there is no such bound."""
        return self.base_demand_vehph() * (np.inf if self.schedule is None else MOST_DEMAND)

    def base_values(self) -> np.ndarray:
        """Return the parameter vector that means the scenario as it is."""
        of_class = dict(zip(self.class_names, self.class_values, strict=True))
        behaviour = [of_class[vtype][attribute] for vtype, attribute in self.layout.driver_parameters]
        return np.concatenate([self.base_demand_vehph(), behaviour])

    def world(
        self,
        values: Float[Array, " parameter"],
        seed: Int[Array, ""],
        depart_s: Float[Array, "*subject"],
        effects: Effects | None = None,
        drive: Int[Array, "*subject"] | None = None,
    ) -> World:
        """Return the world of one run.

        Args:
            values: parameter vector in the order of the layout.
            seed: seed of the run.
            depart_s: when the subject vehicle departs, or each of several; see `SubjectPlan`.
            effects: what the baseline lacks; None for the baseline.
            drive: number of the recorded drive that the run stands for, or each of several subject vehicles; None: of
                none.
        """
        drive = jnp.full(jnp.shape(depart_s), NO_DRIVE) if drive is None else drive
        num_inputs = self.layout.num_inputs
        inputs = values[:num_inputs] if effects is None else true_inputs(effects, values[:num_inputs])
        classes = self._classes(values[num_inputs:])
        if effects is not None:
            classes = classes_with_effects(classes, effects)
        base = jnp.asarray(np.append(np.maximum(self.base_demand_vehph(), 1e-9), 1.0), jnp.float32)
        scale = jnp.append(inputs, 1.0) / base
        rate = jnp.asarray(self.flow_rate_vehps, jnp.float32) * scale[self.flow_input]
        demand = jnp.sum(rate, axis=1)
        share = jnp.cumsum(rate, axis=1) / jnp.maximum(demand, SMALLEST_FLOW_VEHPS)[:, None]
        inflow = Inflow(
            lane_row=jnp.asarray(self.lane_row, jnp.int32),
            start_m=jnp.asarray(self.edge_m[:, 0], jnp.float32),
            end_m=jnp.asarray(self.edge_m[:, 1], jnp.float32),
            serves=jnp.asarray(self.serves),
            is_regular=jnp.asarray(self.is_regular),
            flow_share=share,
            flow_destination=jnp.asarray(self.flow_destination, jnp.int32),
            flow_class=jnp.asarray(self.flow_class, jnp.int32),
            begin_s=jnp.asarray(self.window_s[:, 0], jnp.float32),
            end_s=jnp.asarray(self.window_s[:, 1], jnp.float32),
            timetable=self._timetable(rate, scale, seed, effects),
            rules=jax.tree.map(jnp.asarray, self.rules),
        )
        return World(
            road=self.road,
            inflow=inflow,
            classes=classes,
            demand_vehps=demand,
            subject=SubjectPlan(
                depart_s=depart_s,
                entrance=self.subject_entrance,
                destination=self.subject_destination,
                vehicle_class=len(classes) - 1,
            ),
            seed=seed,
            effects=effects,
            driver=self._driver(drive),
            distant=self._distant(),
            recorded_m=parts_table(self.recorded, drive),
        )

    def _timetable(
        self, rate_vehps: Array, scale: Array, seed: Int[Array, ""], effects: Effects | None
    ) -> Timetable | None:
        if self.schedule is None:
            return None
        schedule = jax.tree.map(jnp.asarray, self.schedule)
        factor = scale[self.flow_input] * self.vehicle_scale
        return timetable(schedule, rate_vehps, factor, seed, effects)

    def _distant(self) -> DistantDrivers | None:
        if not self.distant_vtypes:
            return None
        near = tuple(self.class_names.index(name) for name in self.distant_vtypes)
        distant = tuple(self.class_names.index(name) for name in self.distant_vtypes.values())
        return DistantDrivers(near, distant, *self.sensor_range_m)

    def _driver(self, drive: Int[Array, ""]) -> Planner | LoggedMotion | None:
        if self.subject_model.name == REPLAY:
            return logged_motion_of(self.logged_drives, drive)
        return self.subject_model.planner(*self.sensor_range_m)

    def batch_axes(self, has_effects: bool = False) -> World:
        """Return a world with 0 for each leaf that differs between runs and None for those that all runs share."""
        shared = dict.fromkeys(Inflow.__dataclass_fields__)
        subject = SubjectPlan(
            depart_s=0,  # pyright: ignore[reportArgumentType]
            entrance=self.subject_entrance,
            destination=self.subject_destination,
            vehicle_class=len(self.class_names) - 1 + (NUM_CLASSES_OF_EFFECTS if has_effects else 0),
        )
        table = None if self.schedule is None else Timetable(0, 0, None)  # pyright: ignore[reportArgumentType]
        inflow = Inflow(**(shared | {"flow_share": 0, "timetable": table}))  # pyright: ignore[reportArgumentType]
        effects = 0 if has_effects else None
        driver = LoggedMotion(None, None, None, None, None, log=0) if self.subject_model.name == REPLAY else None  # pyright: ignore
        recorded = None if are_whole(self.recorded) else 0
        return World(None, inflow, 0, 0, subject, 0, effects, driver, self._distant(), recorded)  # pyright: ignore[reportArgumentType]

    def _classes(self, behaviour: Float[Array, " parameter"]) -> tuple[VehicleClass, ...]:
        classes = []
        for name, model, values in zip(self.class_names, self.class_models, self.class_values, strict=True):
            one = vehicle_class(values, model)
            is_subject = len(classes) == len(self.class_names) - 1
            if name in self.layout.vtypes and not is_subject:
                own = zip(self.layout.attributes, self.layout.factors_of(name), strict=True)
                for place, (attribute, (factor, most)) in enumerate(own, self.layout.begin_of(name)):
                    value = behaviour[place] if factor == 1.0 else jnp.minimum(factor * behaviour[place], most)
                    one = with_attribute(one, model, attribute, value)
            classes.append(self.subject_model.vehicle_class(one) if is_subject else one)
        for near, distant in self.distant_vtypes.items():
            place = self.class_names.index(distant)
            classes[place] = distant_class(classes[self.class_names.index(near)], classes[place])
        return tuple(classes)


def build_template(
    scenario: Scenario,
    layout: ParameterLayout,
    subject_model: SubjectModel | None = None,
    sensor_range_m: tuple[float, float] = (150.0, 150.0),
    distant_vtypes: Mapping[str, str] | None = None,
) -> WorldTemplate:
    """Return what all worlds of a scenario share.

    Args:
        scenario: road and traffic.
        layout: meaning of parameter vectors.
        subject_model: who drives the subject vehicle; its vType unless given.
        sensor_range_m: how far it sees ahead and behind.
        distant_vtypes: vType as which each of these vTypes follows beyond that; see `surrogate/loop/distant.py`.

    Raises:
        UnknownModelError: there is no such subject model or parameter.
        ParameterRangeError: a parameter of it is out of range.
        ScenarioError: an input names a flow that the scenario lacks, a vType is missing, or distant vehicles cannot be
            of it.
    """
    subject_model = subject_model or SubjectModel()
    subject_model.check()
    known = scenario.flow_ids
    for name, flows in zip(layout.input_ids, layout.input_flows, strict=True):
        for flow in flows:
            if flow not in known:
                raise ScenarioError(
                    scenario.demand.file, f"input '{name}': expected a <flow id='{flow}'>; there is none."
                )
    for vtype in layout.vtypes:
        if vtype not in scenario.demand.vtypes:
            raise ScenarioError(scenario.demand.file, f"expected a <vType id='{vtype}'>; there is none.")
    input_of = {flow: i for i, flows in enumerate(layout.input_flows) for flow in flows}
    names = list(dict.fromkeys(flow.vtype for flow in scenario.flows))
    distant_vtypes = dict(distant_vtypes or {})
    check_distant_vtypes(scenario, distant_vtypes)
    names += distant_vtypes.values()
    names.append(scenario.demand.subject_vtype)
    queues = queues_of(scenario)
    by_entrance = [queue.flows for queue in queues]
    most = max(1, *(len(flows) for flows in by_entrance))
    shape = (len(queues), most)
    rate, chosen_input = np.zeros(shape), np.full(shape, layout.num_inputs)
    destination, vehicle_classes = np.zeros(shape, int), np.zeros(shape, int)
    window = np.tile([0.0, 1e9], (shape[0], 1))
    for e, flows in enumerate(by_entrance):
        for f, flow in enumerate(flows):
            rate[e, f] = 0.0 if flow.id.startswith(VEHICLES) else flow.rate_vehps
            chosen_input[e, f] = input_of.get(flow.id, layout.num_inputs)
            destination[e, f] = scenario.destinations.index(flow.route[-1])
            vehicle_classes[e, f] = names.index(flow.vtype)
            window[e] = flow.begin_s, flow.end_s
    lane_row, serves, edge_m = entrance_tables(scenario, queues)
    has_schedule = not is_plain(scenario)
    return WorldTemplate(
        layout=layout,
        road=build_road(scenario.row_map, scenario.destination_routes),
        lane_row=lane_row,
        serves=serves,
        edge_m=edge_m,
        window_s=window,
        is_regular=np.asarray([bool(flows) and all(flow.is_regular for flow in flows) for flows in by_entrance]),
        flow_rate_vehps=rate,
        input_vehps=np.asarray([sum(map(scenario.mean_rate_vehps, flows)) for flows in layout.input_flows]),
        flow_input=chosen_input,
        flow_destination=destination,
        flow_class=vehicle_classes,
        class_names=tuple(names),
        class_models=tuple(scenario.model_of(name) for name in names),
        class_values=tuple(scenario.values_of(name) for name in names),
        subject_entrance=0,
        subject_destination=0,
        subject_model=subject_model,
        sensor_range_m=sensor_range_m,
        distant_vtypes=distant_vtypes,
        schedule=schedule_of(scenario, queues) if has_schedule else None,
        rules=rules_of(scenario, queues) if has_schedule else None,
        entrance_of_queue=np.asarray([scenario.entrances.index(q.edge) for q in queues]) if has_schedule else None,
        vehicle_scale=scenario.configuration.scale,
    )
