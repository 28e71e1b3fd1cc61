"""Flow and density on a ring road, against closed forms where a model has one and against SUMO where it has none."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from experiments.fidelity.platoon import LENGTH_M, STEP_S, Platoon, in_sumo, in_surrogate
from sim_adapters.scenario.sumo_names import attribute_values, vehicle_class
from surrogate.car_following.registry import CAR_FOLLOWING_MODELS
from surrogate.vehicle.car_following_model import CarFollowingModel, FollowingSituation
from surrogate.vehicle.vehicle_limits import limited_acceleration, next_speed_mps

DESIRED_MPS = 30.0
NUM_VEHICLES = 20
DURATION_S = 900.0
DISTURBANCE = 0.05
SPEEDS_MPS = (2.0, 6.0, 11.0, 17.0, 24.0)  # of which the density of the closed form is taken
MOST_DIFFERENCE = 0.01

EQUILIBRIUM_GAP_M: dict[str, Callable[[Any, float], float]] = {
    "idm": lambda m, v: (m.jam_gap_m + v * m.time_gap_s) / (1 - (v / DESIRED_MPS) ** m.acceleration_exponent) ** 0.5,
    "iidm": lambda m, v: m.jam_gap_m + v * m.time_gap_s,
    "acc": lambda m, v: m.jam_gap_m + v * m.time_gap_s,
    "krauss": lambda m, v: m.jam_gap_m + v * m.time_gap_s,
    "gipps": lambda m, v: (
        m.jam_gap_m + 1.5 * v * m.time_gap_s
        + 0.5 * v * v * (1 / m.max_deceleration_mps2 - 1 / m.leader_deceleration_mps2)
    ),
    "fvd": lambda m, v: m.jam_gap_m + m.gap_scale_m * (
        m.form_factor
        + np.arctanh(v / DESIRED_MPS * (1 + np.tanh(m.form_factor)) - np.tanh(m.form_factor))
    ),
    "aovrv": lambda m, v: m.jam_gap_m + v * m.time_gap_s,
}  # fmt: skip
NO_EQUILIBRIUM = {
    "ghr": "answers to differences in speed alone: any gap is in equilibrium",
    "w99-vissim": "oscillates between SDXc and SDXo; SUMO has another W99",
}


def speed_on_ring(model: CarFollowingModel, gap_m: float, disturbance: float = 0.0) -> float:
    """Return the mean speed of vehicles of one model on a ring after they have settled.

    The first gaps depart from their mean by a relative disturbance. Where traffic is unstable, waves grow from it, and
    the mean speed is no longer that of the equilibrium.
    """
    first = gap_m * (1.0 + disturbance * jnp.sin(jnp.arange(NUM_VEHICLES) * 2.0 * jnp.pi / NUM_VEHICLES))
    desired = jnp.full(NUM_VEHICLES, DESIRED_MPS)

    def step(carry: tuple[Array, Array, Array], _: None) -> tuple[tuple[Array, Array, Array], Float[Array, ""]]:
        gap, speed, acceleration = carry
        situation = FollowingSituation(
            speed_mps=speed,
            gap_m=gap,
            leader_speed_mps=jnp.roll(speed, 1),
            leader_acceleration_mps2=jnp.roll(acceleration, 1),
            acceleration_mps2=acceleration,
            desired_speed_mps=desired,
            uniform=jnp.full(NUM_VEHICLES, 0.5),
        )
        bounds = (model.max_acceleration_mps2, model.max_deceleration_mps2, model.emergency_deceleration_mps2)
        wanted = model.acceleration(situation, STEP_S)
        possible = limited_acceleration(wanted, speed, desired, *bounds, STEP_S)
        later = next_speed_mps(speed, possible, STEP_S)
        return (gap + STEP_S * (jnp.roll(later, 1) - later), later, (later - speed) / STEP_S), jnp.mean(later)

    start = (first, jnp.full(NUM_VEHICLES, 3.0), jnp.zeros(NUM_VEHICLES))
    _, speeds = jax.jit(lambda carry: jax.lax.scan(step, carry, None, length=round(DURATION_S / STEP_S)))(start)
    return float(jnp.mean(speeds[-round(60.0 / STEP_S) :]))


def closed_form_table() -> list[dict[str, Any]]:
    """Return speed and flow at the densities of the closed forms."""
    rows = []
    for entry in CAR_FOLLOWING_MODELS:
        if entry.name not in EQUILIBRIUM_GAP_M:
            continue
        model = entry.build()
        plain = jax.tree.map(float, model)
        for speed_mps in SPEEDS_MPS:
            gap_m = float(EQUILIBRIUM_GAP_M[entry.name](plain, speed_mps))
            found_mps = speed_on_ring(model, gap_m)
            density_vehpkm = 1000.0 / (gap_m + LENGTH_M)
            rows.append(
                {
                    "model": entry.name,
                    "density_vehpkm": density_vehpkm,
                    "flow_vehph": 3.6 * density_vehpkm * found_mps,
                    "closed_form_vehph": 3.6 * density_vehpkm * speed_mps,
                    "relative_difference": found_mps / speed_mps - 1.0,
                    "relative_difference_disturbed": speed_on_ring(model, gap_m, DISTURBANCE) / speed_mps - 1.0,
                }
            )
    return rows


def sumo_table(model: str, attributes: dict[str, float]) -> list[dict[str, Any]]:
    """Return the flow of a platoon behind a leader of constant speed in both simulators.

    For a model that oscillates: the density is that of the mean gap over the last third of ten minutes.
    """
    numbers = attribute_values({name: str(value) for name, value in attributes.items()}, model)
    following = vehicle_class(numbers, model).car_following
    rows = []
    for speed_mps in SPEEDS_MPS:
        steps = round(600.0 / STEP_S)
        start = np.full(4, 6.0 + 1.5 * speed_mps)
        platoon = Platoon(np.full(steps, speed_mps), start, np.full(4, speed_mps), np.full(4, DESIRED_MPS))
        flow = {}
        for name, places in (
            ("sumo", in_sumo(platoon, model, attributes)),
            ("surrogate", in_surrogate(platoon, following)),
        ):
            spacing_m = -np.diff(places[-steps // 3 :], axis=1).mean()
            flow[name] = 3600.0 * speed_mps / spacing_m
        rows.append(
            {
                "model": model,
                "speed_mps": speed_mps,
                "flow_vehph": flow["surrogate"],
                "sumo_vehph": flow["sumo"],
                "relative_difference": flow["surrogate"] / flow["sumo"] - 1.0,
            }
        )
    return rows
