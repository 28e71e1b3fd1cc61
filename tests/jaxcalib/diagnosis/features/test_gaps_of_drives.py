"""Leaders and gaps of a drive are those that measures see in the same frames."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxcalib.case.safety_limits import USUAL_LIMITS, SafetyLimits
from jaxcalib.measures.observed_road import EndingRows, ObservedRoad
from jaxcalib.measures.scene import MeasureSettings, look, nothing_remembered
from surrogate.road.drive_table import NOBODY, drive_table
from surrogate.road.perception import NO_TRACK, PerceptionFrame

LENGTH_M, NUM_PLACES = 4.7, 12
SETTINGS = MeasureSettings(
    road=ObservedRoad(
        *(jnp.asarray(values) for values in ([0.0, 900.0], [0.0, 900.0], [0.0, 2700.0], [0.0, 1.0, 2.0])),
        EndingRows(*(jnp.zeros(0) for _ in range(4))),
    ),
    nominal_length_m=jnp.asarray(LENGTH_M),
    least_speed_mps=jnp.asarray(1.0),
    longest_headway_s=jnp.asarray(5.0),
    limits=SafetyLimits(*(jnp.asarray(limit) for limit in USUAL_LIMITS)),
    num_tracks=NUM_PLACES + 2,
    num_target_gap_classes=4,
)


def frame_of(row: list[int], offset_m: list[float]) -> PerceptionFrame:
    """Return a frame; the object at distance 0 is the subject vehicle."""
    order = np.lexsort((-np.asarray(offset_m), row))
    number = len(order)

    def objects(values: np.ndarray, kind: type) -> jnp.ndarray:
        return jnp.asarray(np.pad(values[order], (0, NUM_PLACES - number)).astype(kind))

    is_subject = np.asarray(offset_m) == 0.0
    return PerceptionFrame(
        time_s=jnp.asarray(300.0), valid=jnp.asarray(True), subject_position_m=jnp.asarray(400.0),
        subject_speed_mps=jnp.asarray(20.0), subject_acceleration_mps2=jnp.asarray(0.0), num_lanes=jnp.asarray(3.0),
        object_valid=objects(np.ones(number), bool), object_is_subject=objects(is_subject, bool),
        object_track=objects(np.where(is_subject, NO_TRACK, np.arange(number)), np.int32),
        object_row=objects(np.asarray(row), np.int32), object_offset_m=objects(np.asarray(offset_m), np.float32),
        object_speed_mps=objects(np.full(number, 20.0), np.float32),
        object_lateral_m=objects(np.zeros(number), np.float32),
        ahead_m=jnp.asarray(150.0), behind_m=jnp.asarray(120.0),
    )  # fmt: skip


def seen_by_both(row: list[int], offset_m: list[float]) -> tuple[np.ndarray, ...]:
    frame = frame_of(row, offset_m)
    scene = look(frame, nothing_remembered(SETTINGS.num_tracks), jnp.asarray(-jnp.inf), SETTINGS)
    stacked = PerceptionFrame(
        *(jnp.asarray(getattr(frame, name))[None] for name in PerceptionFrame.__dataclass_fields__)
    )
    table = drive_table(stacked, 0.5)
    count = len(row)
    scenes = (np.asarray(values)[:count] for values in (scene.has_leader, scene.has_follower, scene.gap_m))
    return (table.leader != NOBODY, table.follower != NOBODY, table.gap_m(LENGTH_M), *scenes)


def test_gaps_of_a_row_by_hand():
    has_leader, has_follower, gap_m, *_ = seen_by_both([0, 1, 0, 1], [0.0, 31.0, 42.5, -17.25])
    assert has_leader.tolist() == [False, True, False, True]  # sorted by (row, -position)
    assert has_follower.tolist() == [True, False, True, False]
    assert gap_m == pytest.approx([np.inf, 42.5 - LENGTH_M, np.inf, 48.25 - LENGTH_M])


@settings(max_examples=40, deadline=None)
@given(
    others=st.lists(
        st.tuples(st.integers(0, 2), st.integers(-119, 149).filter(bool)), max_size=NUM_PLACES - 1, unique=True
    )
)
def test_drives_and_measures_see_the_same_leaders_and_gaps(others: list[tuple[int, int]]):
    row, offset_m = [1, *(row for row, _ in others)], [0.0, *(float(offset_m) for _, offset_m in others)]
    has_leader, has_follower, gap_m, scene_leader, scene_follower, scene_gap_m = seen_by_both(row, offset_m)
    np.testing.assert_array_equal(has_leader, scene_leader)
    np.testing.assert_array_equal(has_follower, scene_follower)
    np.testing.assert_allclose(gap_m, scene_gap_m, atol=1e-4)
