"""The one driver of all folds: from the frames of a drive to its vector of tallies."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxcalib.measures.fold import Fold, indexed
from jaxcalib.measures.scene import MeasureSettings, Memory, look, nothing_remembered, remember
from surrogate.road.perception import PerceptionFrame
from surrogate.xla.materialise import materialise


class DriveState(eqx.Module):
    """A drive so far."""

    previous_s: Float[Array, ""]  # time of the last frame
    memory: Memory  # what is remembered of each vehicle
    track_sums: Float[Array, "track sum"]  # sums over frames for each vehicle
    tally: Float[Array, " tally"]  # sums over frames


class DriveTally(eqx.Module):
    """Turns the frames of a drive into tallies."""

    settings: MeasureSettings  # conventions
    folds: tuple[Fold, ...]  # what is counted

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the tallies, in the order of the vector."""
        return tuple(name for fold in self.folds for name in fold.names())

    @property
    def track_names(self) -> tuple[str, ...]:
        """Names of the sums kept for each vehicle."""
        return tuple(name for fold in self.folds for name in fold.track_names())

    def start(self) -> DriveState:
        """Return the state before the first frame."""
        num_tracks = self.settings.num_tracks
        return DriveState(
            previous_s=jnp.asarray(-jnp.inf, jnp.float32),
            memory=nothing_remembered(num_tracks),
            track_sums=jnp.zeros((num_tracks, len(self.track_names)), jnp.float32),
            tally=jnp.zeros((len(self.names),), jnp.float32),
        )

    def update(self, state: DriveState, frame: PerceptionFrame) -> DriveState:
        """Return the state after one more frame; one that is not valid adds nothing, and what was seen is forgotten."""
        scene = materialise(look(materialise(frame), state.memory, state.previous_s, self.settings))
        counted: dict[str, Array] = {}
        per_track: dict[str, Array] = {}
        for fold in self.folds:
            counted |= fold.count(scene)
            per_track |= fold.count_per_track(scene)
        tally = jnp.where(frame.valid, self._vector(counted), 0.0)
        sums = jnp.stack([per_track[name] for name in self.track_names], axis=-1)
        return DriveState(
            previous_s=jnp.where(frame.valid, frame.time_s, state.previous_s),
            # across a gap in a log time goes by for the subject vehicle, but nothing is known of the others
            memory=jax.tree.map(
                lambda kept, forgotten: jnp.where(frame.valid, kept, forgotten),
                remember(state.memory, scene),
                nothing_remembered(self.settings.num_tracks),
            ),
            track_sums=state.track_sums.at[scene.slot].add(sums, mode="promise_in_bounds"),
            tally=state.tally + tally,
        )

    def finish(self, state: DriveState) -> Float[Array, " tally"]:
        """Return the tallies of a drive that is over."""
        remembered = state.track_sums[:-1]  # the last slot collects what has no track
        tracks = {name: remembered[:, index] for index, name in enumerate(self.track_names)}
        settled: dict[str, Array] = {}
        for fold in self.folds:
            settled |= fold.settle(tracks)
        return state.tally + self._vector(settled)

    def of_frames(self, frames: PerceptionFrame) -> Float[Array, " tally"]:
        """Return the tallies of a whole drive, its frames stacked along a leading time axis."""

        def body(state: DriveState, frame: PerceptionFrame) -> tuple[DriveState, None]:
            return self.update(state, frame), None

        state, _ = jax.lax.scan(body, self.start(), frames)
        return self.finish(state)

    def _vector(self, values: dict[str, Array]) -> Float[Array, " tally"]:
        """Return numbers by name, and arrays by the name before the index, in the order of all names."""
        names, left, parts = list(self.names), dict(values), []
        while names:
            name = names[0] if names[0] in left else names[0].removesuffix("[0]")
            part = left.pop(name, jnp.zeros(()))
            own = indexed(name, len(part)) if part.ndim else names[:1]
            if names[: len(own)] != list(own):
                raise KeyError(f"a fold counts {len(own)} numbers as {name}, for which it does not have as many names")
            del names[: len(own)]
            parts.append(jnp.atleast_1d(part))
        if left:
            raise KeyError(f"a fold counts what it does not name: {sorted(left)}")
        return jnp.concatenate(parts).astype(jnp.float32)
