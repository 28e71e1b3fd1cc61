import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from sim_adapters.world.world_builder import WorldTemplate
from surrogate.lane_change.vehicles_on_road import NO_ROW, Guide, guide_table


def test_a_word_holds_what_the_tables_say(template: WorldTemplate):
    road = template.road
    guide = Guide(guide_table(road))
    shape = road.track_end.shape
    np.testing.assert_array_equal(guide.track_end, road.track_end)
    np.testing.assert_array_equal(guide.best_lane_offset, road.best_lane_offset)
    assert int(jnp.min(road.best_lane_offset)) < 0 < int(jnp.max(road.best_lane_offset))
    for found, table in (
        (guide.right_row, road.right_row),
        (guide.left_row, road.left_row),
        (guide.leads_elsewhere, road.leads_elsewhere),
    ):
        np.testing.assert_array_equal(found, jnp.broadcast_to(table, shape))
    assert set(np.sign(np.asarray(road.right_row)).ravel().tolist()) >= {-1, 0}  # with and without a row there


def test_a_road_too_wide_for_a_word_is_refused(template: WorldTemplate):
    tall = jnp.zeros((NO_ROW, template.road.num_segments), jnp.float32)
    road = dataclasses.replace(template.road, speed_limit_mps=tall)
    with pytest.raises(ValueError, match="rows"):
        guide_table(road)
