"""Objects are reported late, as they were some time ago; the subject vehicle's own state is not."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from surrogate.effects.base import ActsOn, Dial, Effect, Reading
from surrogate.road.drive_table import NOBODY, DriveTable, LogFormat
from surrogate.road.perception import NO_TRACK, PerceptionFrame, is_other

KEPT = 3  # earlier frames that are kept; a longer latency is cut to their age
NUM_SLOTS = 512  # of the table in which an earlier place of a track is looked up
Past = tuple[PerceptionFrame, ...]  # latest first


def _watch(frame: PerceptionFrame) -> Past:
    blank = dataclasses.replace(frame, valid=jnp.zeros_like(frame.valid))
    return (blank,) * KEPT


def _sense(dial: Dial, frame: PerceptionFrame, memory: Any, seed: Array) -> tuple[PerceptionFrame, Past]:
    """Return the objects as they were, between the two frames around that time."""
    del seed
    frames = (frame, *memory)
    after = (frame, *memory[:-1])
    time_s = jnp.stack([earlier.time_s for earlier in frames])
    is_past = jnp.stack([earlier.valid for earlier in frames]) & (time_s <= frame.time_s)
    is_past = jnp.cumprod(is_past.astype(jnp.int32)) > 0  # no frame beyond a gap
    age_s = jnp.where(is_past, frame.time_s - time_s, jnp.inf)
    newer = jnp.clip(jnp.sum(age_s <= dial.strength) - 1, 0, KEPT - 1)
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *frames)
    new = jax.tree.map(lambda leaf: leaf[newer], stacked)
    old = jax.tree.map(lambda leaf: leaf[newer + 1], stacked)
    old_age_s = age_s[newer + 1]
    span_s = old_age_s - age_s[newer]
    share = jnp.clip((dial.strength - age_s[newer]) / jnp.maximum(span_s, 1e-3), 0.0, 1.0)
    share = jnp.where(jnp.isfinite(old_age_s), share, 0.0)

    entry = _entry_of_track(new.object_track, old)
    same = is_other(new) & (old.object_track[entry] == new.object_track) & old.object_valid[entry]

    def between(name: str) -> Float[Array, " object"]:
        now, then = getattr(new, name), getattr(old, name)[entry]
        return now + share * (jnp.where(same, then, now) - now)

    is_subject = new.object_is_subject
    own_row = jnp.sum(jnp.where(frame.object_is_subject, frame.object_row, 0))
    own_lateral = jnp.sum(jnp.where(frame.object_is_subject, frame.object_lateral_m, 0.0))
    is_old_row = same & (share > 0.5)
    row = jnp.where(is_old_row, old.object_row[entry], new.object_row)
    lateral = jnp.where(is_old_row, old.object_lateral_m[entry], new.object_lateral_m)
    late = dataclasses.replace(
        frame,
        object_valid=new.object_valid,
        object_is_subject=is_subject,
        object_track=new.object_track,
        object_row=jnp.where(is_subject, own_row, row),
        object_offset_m=jnp.where(is_subject, 0.0, between("object_offset_m")),
        object_speed_mps=jnp.where(is_subject, frame.subject_speed_mps, between("object_speed_mps")),
        object_lateral_m=jnp.where(is_subject, own_lateral, lateral),
    )
    is_late = (dial.strength > 0.0) & new.valid & frame.valid
    return jax.tree.map(lambda a, b: jnp.where(is_late, a, b), late, frame), after


def _entry_of_track(track: Int[Array, " object"], old: PerceptionFrame) -> Int[Array, " object"]:
    """Entry that each track may have had in an older frame; the caller checks that it had."""
    number = jnp.arange(old.object_track.shape[0], dtype=jnp.int32)
    slot = jnp.where(old.object_track != NO_TRACK, old.object_track % NUM_SLOTS, NUM_SLOTS)
    table = jnp.zeros((NUM_SLOTS + 1,), jnp.int32).at[slot].set(number)
    return table[track % NUM_SLOTS]


def _alter(table: DriveTable, strength: float, log: LogFormat, random: np.random.Generator) -> DriveTable:
    """The drive with its objects some whole steps later."""
    del log, random
    steps = round(strength / table.interval_s)
    if steps == 0:
        return table
    objects = np.flatnonzero(~table.is_subject)
    instant = table.instant[objects] + steps
    objects, instant = objects[instant < len(table.time_s)], instant[instant < len(table.time_s)]
    own = np.flatnonzero(table.is_subject)
    own_row = np.full(len(table.time_s), NOBODY)
    own_row[table.instant[own]] = own
    has = own_row[instant] >= 0
    objects, instant = objects[has], instant[has]
    rows = np.concatenate([objects, own])
    late = table.select(rows, instant=np.concatenate([instant, table.instant[own]]))
    subject_m = np.zeros(len(table.time_s))
    subject_m[table.instant[own]] = table.position_m[own]
    return dataclasses.replace(late, position_m=subject_m[late.instant] + late.offset_m).sorted()


SENSOR_LATENCY = Effect(
    name="sensor_latency",
    title="objects reported late",
    unit="s by which objects are reported late",
    weak=0.2,
    medium=0.4,
    strong=0.7,
    acts_on=ActsOn.SENSOR,
    source="delays of detection and tracking; range by judgement. Between frames, motion is taken as even",
    reading=Reading.LATENCY,
    is_whole_steps=True,
    alter=_alter,
    watch=_watch,
    sense=_sense,
)
