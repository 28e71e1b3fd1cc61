"""What a lane-change model answers that replaces LC2013's free motives, and what it is told.

What the route demands and how neighbours talk stays LC2013's. To add a model: write one file with a subclass of
`FreeModel`, and enter it in `registry.py`.
"""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.lane_change.cooperation import NO_ADVICE
from surrogate.lane_change.gap_acceptance import Blocked, Ego, Following
from surrogate.lane_change.lc2013 import Lc2013
from surrogate.lane_change.motives import Wish
from surrogate.lane_change.old_follower import OldFollower
from surrogate.lane_change.strategy import Strategy
from surrogate.vehicle.lane_change_model import LaneChangeModel, Reason, Side
from surrogate.vehicle.vehicle_class import VehicleClass, select_record

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]
Pair = tuple[Any, Any]  # to the right, to the left


class Outlook(eqx.Module):
    """What a driver knows when he judges his lanes; pairs are (right, left)."""

    ego: Ego  # each vehicle and its own lane
    sides: tuple[Side, Side]  # the lanes beside
    routes: tuple[Strategy, Strategy]  # what the route says of them
    secure_gaps: tuple[Blocked, Blocked]  # who is in the way there by LC2013's rule
    vehicle_class: Int[Array, " vehicle"]  # class of each vehicle
    old_follower: OldFollower  # who follows each vehicle in its own row
    following: Following  # car-following models
    step_s: float = eqx.field(static=True)  # length of a time step


class FreeModel(LaneChangeModel):
    """A model with free motives of its own, and perhaps gaps of its own."""

    @abc.abstractmethod
    def route_parameters(self) -> Lc2013:
        """Return the parameters for route and talk as a record of LC2013, whose motives then play no part."""

    def gaps(self, outlook: Outlook) -> tuple[Blocked, Blocked]:
        """Who is in the way on each side; LC2013's secure gaps unless the model has a rule of its own."""
        return outlook.secure_gaps

    @abc.abstractmethod
    def wishes(
        self, outlook: Outlook, gaps: tuple[Blocked, Blocked], is_asked_to_help: tuple[Flag, Flag]
    ) -> tuple[Wish, Wish]:
        """Return the wishes to the right and to the left.

        Args:
            outlook: what the drivers know.
            gaps: who is in the way.
            is_asked_to_help: whether somebody who must change in this direction has asked for room.
        """

    def most_asked_mps2(self) -> Float[Array, "..."]:
        """Return the hardest braking that the driver does for others' lane changes; inf for any that they ask."""
        return jnp.asarray(jnp.inf)


def free_wish(route: Strategy, wants: Flag, reason: Array | int) -> Wish:
    """Return the wish of a driver who goes where the route needs it or where he `wants` for a `reason`."""
    none = jnp.zeros_like(route.look_ahead_m)
    return Wish(
        change=route.must_change | wants,
        urgent=route.must_change,
        reason=jnp.where(route.must_change, int(Reason.STRATEGIC), reason),
        gain=none,
        keep_right=none,
        advice_mps2=jnp.full_like(none, NO_ADVICE),
        reverts=jnp.zeros_like(wants),
    )


def free_models(outlook: Outlook, classes: tuple[VehicleClass, ...]) -> list[tuple[FreeModel, Flag]]:
    """Return each kind of such a model that occurs, with its parameters by vehicle, and whose model it is."""
    parts = []
    models = [c.lane_change for c in classes]
    for kind in dict.fromkeys(type(model) for model in models):
        if not issubclass(kind, FreeModel):
            continue
        members = [index for index, model in enumerate(models) if type(model) is kind]
        own = [model if type(model) is kind else models[members[0]] for model in models]
        of_vehicle = select_record(own, outlook.vehicle_class)
        assert isinstance(of_vehicle, FreeModel)
        parts.append((of_vehicle, jnp.isin(outlook.vehicle_class, jnp.asarray(members))))
    return parts


def of_members(is_member: Flag, theirs: Any, others: Any) -> Any:
    """Return one record for all: the members' and the others'."""
    return jax.tree.map(lambda mine, other: jnp.where(is_member, mine, other), theirs, others)
