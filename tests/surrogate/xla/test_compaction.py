import jax
import numpy as np
import pytest

from surrogate.xla.compaction import first_true

SIZE = 9
choose = jax.jit(first_true, static_argnums=1)


@pytest.mark.parametrize("share", [0.0, 0.03, 0.2, 0.9, 1.0])
def test_the_first_true_entries_are_found_in_order_and_the_rest_is_marked_as_missing(share: float) -> None:
    rng = np.random.default_rng(round(100 * share))
    for _ in range(20):
        mask = rng.random(77) < share
        index, is_there = choose(mask, SIZE)
        expected = np.flatnonzero(mask)[:SIZE]
        assert np.asarray(is_there).tolist() == [place < len(expected) for place in range(SIZE)]
        np.testing.assert_array_equal(np.asarray(index)[: len(expected)], expected)
        assert (np.asarray(index) < len(mask)).all()  # what is missing may still be looked up
