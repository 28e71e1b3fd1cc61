"""A platoon behind a leader with a given speed profile, in SUMO and in the surrogate, step by step."""

import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from sim_adapters.scenario.sumo_names import attribute_values, vehicle_class
from surrogate.car_following.replay import ReplayStart, replay
from surrogate.vehicle.car_following_model import CarFollowingModel

STEP_S = 0.1
LENGTH_M = 5.0
ROAD_M = 100_000.0
LIMIT_MPS = 70.0
MARGIN_M = 100.0  # behind the last follower

NET = f"""<net version="1.20">
 <location netOffset="0.00,0.00" convBoundary="0.00,0.00,{ROAD_M},0.00" origBoundary="0,0,0,0" projParameter="!"/>
 <edge id="road" from="a" to="b"><lane id="road_0" index="0" speed="{LIMIT_MPS}" length="{ROAD_M}" shape="0,0 {ROAD_M},0"/></edge>
 <junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0 0,3"/>
 <junction id="b" type="dead_end" x="{ROAD_M}" y="0" incLanes="road_0" intLanes="" shape="{ROAD_M},0 {ROAD_M},3"/>
</net>
"""  # noqa: E501


@dataclass(frozen=True)
class Platoon:
    """Vehicles in one lane."""

    leader_mps: Float[np.ndarray, " step"]  # the leader's speed at the beginning of each step
    gap_m: Float[np.ndarray, " follower"]  # gap of each follower at the beginning, the first one's first
    speed_mps: Float[np.ndarray, " follower"]  # its speed then
    desired_mps: Float[np.ndarray, " follower"]  # its desired speed

    @property
    def start_m(self) -> Float[np.ndarray, " vehicle"]:
        """Front bumpers at the beginning, the leader's first."""
        behind = np.concatenate([[0.0], np.cumsum(self.gap_m + LENGTH_M)])
        return MARGIN_M + behind[-1] - behind


def in_surrogate(platoon: Platoon, model: CarFollowingModel) -> Float[np.ndarray, "step vehicle"]:
    """Return front bumpers at the beginning of each step, in double precision where JAX has that enabled."""
    leader = jnp.asarray(platoon.leader_mps, float)[:, None]
    travelled = np.concatenate([[0.0], np.cumsum(STEP_S * platoon.leader_mps[1:])])
    places = [platoon.start_m[0] + travelled]
    for index in range(len(platoon.gap_m)):
        start = ReplayStart(
            speed_mps=jnp.asarray([platoon.speed_mps[index]], float),
            acceleration_mps2=jnp.zeros(1),
            gap_m=jnp.asarray([platoon.gap_m[index]], float),
            leader_acceleration_mps2=jnp.zeros(1),
            desired_speed_mps=jnp.asarray([platoon.desired_mps[index]], float),
        )
        _, states = replay(model, start, leader, jnp.full(1, 0.5), STEP_S)
        speed = np.concatenate([[platoon.speed_mps[index]], np.asarray(states.speed_mps[:-1, 0], float)])
        gap = np.concatenate([[platoon.gap_m[index]], np.asarray(states.gap_m[:-1, 0], float)])
        places.append(places[-1] - LENGTH_M - gap)
        leader = jnp.asarray(speed, float)[:, None]
    return np.stack(places, axis=1)


def in_sumo(platoon: Platoon, model: str, attributes: Mapping[str, float]) -> Float[np.ndarray, "step vehicle"]:
    """Return front bumpers at the beginning of each step, with SUMO's model and its attributes for the followers."""
    written = " ".join(f'{name}="{value:.9g}"' for name, value in attributes.items())
    # followers look at how hard the leader may brake; the speed that is set for it obeys no limits
    decel = f'decel="{attributes["decel"]:.9g}" emergencyDecel="{max(9.0, attributes["decel"]):.9g}"'
    lines = [f'<vType id="leader" length="{LENGTH_M}" maxSpeed="{LIMIT_MPS}" {decel} speedFactor="1"/>']
    speeds = [platoon.leader_mps[0], *platoon.speed_mps]
    for index, desired in enumerate(platoon.desired_mps):
        lines.append(
            f'<vType id="t{index}" carFollowModel="{model}" length="{LENGTH_M}" maxSpeed="{desired:.9g}" '
            f'speedFactor="1" speedDev="0" {written}/>'
        )
    lines.append('<route id="r" edges="road"/>')
    for index, (position_m, speed) in enumerate(zip(platoon.start_m, speeds, strict=True)):
        kind = f"t{index - 1}" if index else "leader"
        lines.append(
            f'<vehicle id="{index}" type="{kind}" route="r" depart="0" departPos="{position_m:.9g}" '
            f'departSpeed="{speed:.9g}" insertionChecks="none"/>'
        )
    with TemporaryDirectory(prefix="jaxcalib-platoon-") as name:
        folder = Path(name)
        (folder / "net.net.xml").write_text(NET, encoding="utf-8")
        (folder / "demand.rou.xml").write_text("<routes>" + "\n".join(lines) + "</routes>", encoding="utf-8")
        np.save(folder / "leader.npy", platoon.leader_mps)
        subprocess.run(
            [sys.executable, "-m", "experiments.fidelity.sumo_platoon", name, str(len(speeds))],
            check=True, capture_output=True, cwd=Path(__file__).parents[2],
        )  # fmt: skip
        return np.load(folder / "places.npy")


@dataclass(frozen=True)
class Difference:
    """Largest difference between the positions of any follower in both simulators at any step."""

    double_m: float  # with the surrogate in double precision, as SUMO: what its equations are worth
    single_m: float  # in single precision, in which it runs; a model with thresholds may cross one a step earlier


def largest_difference(platoon: Platoon, model: str, attributes: Mapping[str, float]) -> Difference:
    """Return how far both simulators are apart."""
    numbers = attribute_values({name: str(value) for name, value in attributes.items()}, model)
    theirs = in_sumo(platoon, model, attributes)
    following = vehicle_class(numbers, model).car_following
    single = np.abs(in_surrogate(platoon, following) - theirs)[:, 1:].max()
    with jax.enable_x64():
        # seven digits of a number in single precision give back what was written
        exact = jax.tree.map(lambda leaf: jnp.asarray(float(f"{float(leaf):.7g}")), following)
        double = np.abs(in_surrogate(platoon, exact) - theirs)[:, 1:].max()
    return Difference(double_m=float(double), single_m=float(single))
