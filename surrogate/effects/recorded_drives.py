"""Effects put into drives that are there already: what sensors report, and when drivers act.

Drives of any simulator, or of the road, are altered at the sampling of their log. An effect may have code of its own
for whole drives, whose past and future are known (`Effect.alter`); a sensor's effect without it acts frame by frame, as
in the simulator.
"""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np

from surrogate.effects.apply import sense_drive
from surrogate.effects.base import Effect, EffectSetting
from surrogate.effects.registry import EFFECTS
from surrogate.effects.settings import Effects, settings_table
from surrogate.road.drive_table import DriveTable, LogFormat, as_logged, drive_table
from surrogate.road.perception import NO_TRACK, PerceptionFrame

FRAMES_STEP, OBJECTS_STEP = 256, 16  # frames and places are filled up to multiples, so that few shapes are compiled
LARGEST_SEED = 2**31 - 1


def alter_drive(
    table: DriveTable, effect: Effect, strength: float, log: LogFormat, random: np.random.Generator
) -> DriveTable:
    """A recorded drive with an effect in it, as its log would hold it.

    Args:
        table: the drive, rounded as a log rounds it.
        effect: what to put in.
        strength: in the effect's unit, with its sign.
        log: range and rounding of the log.
        random: for what the effect leaves to chance.
    """
    if effect.alter is not None:
        return effect.alter(table, strength, log, random)
    return sense_table(table, effect, strength, log, int(random.integers(0, LARGEST_SEED)))


def sense_table(table: DriveTable, effect: Effect, strength: float, log: LogFormat, seed: int) -> DriveTable:
    """A recorded drive as a sensor's effect reports it, frame by frame; what leaves the range is gone."""
    frames = _frames_of(table, log)
    settings = Effects(jnp.asarray(settings_table({effect.name: EffectSetting(strength)})))
    sensed = _sense(EFFECTS, frames, settings, jnp.asarray(seed, jnp.int32))
    num_frames = len(table.time_s)

    def change_of(name: str) -> np.ndarray:
        """What the sensors change of the subject vehicle's own state, without the rounding of single precision."""
        return np.asarray(getattr(sensed, name) - getattr(frames, name), np.float64)[:num_frames]

    own = {name: getattr(table, name) + change_of(name) for name in ("subject_speed_mps", "subject_acceleration_mps2")}
    reported = drive_table(jax.tree.map(lambda leaf: leaf[:num_frames], sensed), table.interval_s)
    subject_m = _subject_position_m(table) + change_of("subject_position_m")
    position_m = subject_m[reported.instant] + reported.offset_m
    seen = (reported.offset_m <= log.ahead_m) & (reported.offset_m >= -log.behind_m)
    reported = dataclasses.replace(reported, time_s=table.time_s, position_m=position_m, **own).select(seen)
    return as_logged(reported.sorted(), log)


@functools.partial(jax.jit, static_argnums=0)
def _sense(
    registry: tuple[Effect, ...], frames: PerceptionFrame, settings: Effects, seed: jax.Array
) -> PerceptionFrame:
    """The frames as the sensors report them; another registry is traced anew."""
    del registry
    return sense_drive(frames, settings, seed)


def _subject_position_m(table: DriveTable) -> np.ndarray:
    position_m = np.zeros(len(table.time_s))
    position_m[table.instant[table.is_subject]] = table.position_m[table.is_subject]
    return position_m


def _frames_of(table: DriveTable, log: LogFormat) -> PerceptionFrame:
    """The frames of a drive, filled up with frames that are not valid."""
    num_instants = len(table.time_s)
    number = np.bincount(table.instant, minlength=num_instants)
    first = np.cumsum(number) - number
    entry = np.arange(len(table.instant)) - first[table.instant]
    num_frames = _filled_up(num_instants, FRAMES_STEP)
    shape = (num_frames, _filled_up(int(number.max(initial=1)), OBJECTS_STEP))

    def objects(values: np.ndarray, dtype: type, empty: float | int = 0) -> jax.Array:
        filled = np.full(shape, empty, dtype)
        filled[table.instant, entry] = values
        return jnp.asarray(filled)

    def instants(values: np.ndarray, dtype: type = np.float32) -> jax.Array:
        return jnp.asarray(np.pad(values.astype(dtype), (0, num_frames - num_instants)))

    return PerceptionFrame(
        time_s=instants(table.time_s),
        valid=instants(table.is_valid, bool),
        subject_position_m=instants(_subject_position_m(table)),
        subject_speed_mps=instants(table.subject_speed_mps),
        subject_acceleration_mps2=instants(table.subject_acceleration_mps2),
        num_lanes=jnp.zeros(num_frames, jnp.float32),
        object_valid=objects(np.ones(len(table.instant)), bool),
        object_is_subject=objects(table.is_subject, bool),
        object_track=objects(table.track, np.int32, NO_TRACK),
        object_row=objects(table.lane, np.int32),
        object_offset_m=objects(table.offset_m, np.float32),
        object_speed_mps=objects(table.speed_mps, np.float32),
        object_lateral_m=objects(table.lateral_m, np.float32),
        ahead_m=jnp.full(num_frames, log.ahead_m, jnp.float32),
        behind_m=jnp.full(num_frames, log.behind_m, jnp.float32),
    )


def _filled_up(number: int, step: int) -> int:
    return step * -(-number // step)
