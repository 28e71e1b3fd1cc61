"""Keeps the frames of surrogate runs, so that features written for whole drives serve them, too."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from surrogate.road.drive_table import DriveTable
from surrogate.road.perception import PerceptionFrame

NUM_SUBJECT_VALUES = 4
SPEED_STEP_MPS = 0.0025  # what is kept of speeds and places: finer than what logs hold
PLACE_STEP_M = 0.02
SUBJECT_BIT, SEEN_BIT, LANE_SHIFT = 1, 2, 2
LATERAL_STEP_M = 0.02


class RecordedFrames(eqx.Module):
    """Frames by now."""

    number: Int[Array, ""]  # frames recorded
    subject: Float[Array, "frame value"]  # time, position, speed, acceleration of the subject vehicle, [frame, value]
    # offset, speed, track, flags with the lane, place across; 16-bit numbers, [frame, value, object]
    objects: Int[Array, "frame value object"]


class FrameRecorder(eqx.Module):
    """An observer that keeps frames."""

    num_frames: int = eqx.field(static=True)  # places for frames; later ones are dropped
    num_objects: int = eqx.field(static=True)  # places for objects in a frame

    def start(self) -> RecordedFrames:
        """Return the state before the first frame."""
        return RecordedFrames(
            jnp.zeros((), jnp.int32),
            jnp.zeros((self.num_frames, NUM_SUBJECT_VALUES), jnp.float32),
            jnp.zeros((self.num_frames, 5, self.num_objects), jnp.int16),
        )

    def update(self, state: RecordedFrames, frame: PerceptionFrame) -> RecordedFrames:
        """Return the state after one more frame."""
        subject = jnp.stack(
            [
                frame.time_s, frame.subject_position_m, frame.subject_speed_mps, frame.subject_acceleration_mps2,
            ]
        ).astype(jnp.float32)  # fmt: skip
        # the seen objects first, as they are: by (row, -position)
        order = jnp.argsort(~frame.object_valid, stable=True)[: self.num_objects]
        flags = SEEN_BIT * frame.object_valid + SUBJECT_BIT * frame.object_is_subject
        objects = jnp.stack(
            [
                jnp.round(frame.object_offset_m / PLACE_STEP_M),
                jnp.round(frame.object_speed_mps / SPEED_STEP_MPS),
                frame.object_track,
                flags + (frame.object_row << LANE_SHIFT),
                jnp.round(jnp.nan_to_num(frame.object_lateral_m) / LATERAL_STEP_M),
            ]
        ).astype(jnp.int16)[:, order]  # fmt: skip
        slot = jnp.where(frame.valid, state.number, self.num_frames)  # what is not valid falls off the end
        return RecordedFrames(
            state.number + frame.valid,
            state.subject.at[slot].set(subject, mode="drop"),
            # a narrow road has fewer objects than there are places
            state.objects.at[slot, :, : objects.shape[1]].set(objects, mode="drop"),
        )

    def finish(self, state: RecordedFrames) -> Float[Array, " word"]:
        """Return all frames as one vector; `recorded_table` reads it."""
        number = jnp.minimum(state.number, self.num_frames).astype(jnp.float32)
        return jnp.concatenate([number[None], state.subject.reshape(-1), state.objects.reshape(-1).astype(jnp.float32)])

    def table(self, observed: np.ndarray, interval_s: float) -> DriveTable:
        """Return the drive that a run observed, from what `finish` returned; a gap in it is one in the table, too."""
        number = int(observed[0])
        end = 1 + self.num_frames * NUM_SUBJECT_VALUES
        subject = observed[1:end].reshape(self.num_frames, NUM_SUBJECT_VALUES)[:number].astype(np.float64)
        objects = observed[end:].reshape(self.num_frames, 5, self.num_objects)[:number]
        flags = objects[:, 3].astype(np.int64)
        frame, slot = np.nonzero(flags & SEEN_BIT)
        offset, speed, track, _, lateral = (objects[frame, value, slot] for value in range(5))
        flags = flags[frame, slot]
        offset_m = offset.astype(np.float64) * PLACE_STEP_M
        instant = np.round((subject[:, 0] - subject[:1, 0]) / interval_s).astype(int)  # of each frame
        whole = np.zeros((instant.max(initial=-1) + 1, NUM_SUBJECT_VALUES))
        whole[instant] = subject
        is_valid = np.zeros(len(whole), bool)
        is_valid[instant] = True
        return DriveTable(
            interval_s=interval_s,
            time_s=subject[:1, 0] + interval_s * np.arange(len(whole)),
            is_valid=is_valid,
            subject_acceleration_mps2=whole[:, 3],
            subject_speed_mps=whole[:, 2],
            instant=instant[frame],
            track=np.where(flags & SUBJECT_BIT, -1, track.astype(int)),
            lane=flags >> LANE_SHIFT,
            offset_m=offset_m,
            position_m=subject[frame, 1] + offset_m,
            speed_mps=speed.astype(np.float64) * SPEED_STEP_MPS,
            lateral_m=lateral.astype(np.float64) * LATERAL_STEP_M,
        )
