import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from surrogate.xla.counting import BLOCK, running_count


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(0, 2), min_size=1, max_size=3 * BLOCK + 5))
def test_counts_like_a_cumulative_sum(numbers: list[int]):
    found = running_count(jnp.asarray(numbers, jnp.int32))
    assert found.dtype == jnp.int32
    np.testing.assert_array_equal(found, np.cumsum(numbers))
