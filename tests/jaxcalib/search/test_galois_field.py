import numpy as np
import pytest

from jaxcalib.search.orthogonal_arrays.galois_field import FIELD_ORDERS, galois_field


@pytest.mark.parametrize("order", FIELD_ORDERS)
def test_tables_satisfy_the_field_axioms(order: int) -> None:
    field = galois_field(order)
    add, times = field.addition, field.multiplication
    a, b, c = np.meshgrid(*[np.arange(order)] * 3, indexing="ij")
    assert (add == add.T).all()
    assert (times == times.T).all()
    assert (add[add[a, b], c] == add[a, add[b, c]]).all()
    assert (times[times[a, b], c] == times[a, times[b, c]]).all()
    assert (times[a, add[b, c]] == add[times[a, b], times[a, c]]).all()
    assert (add[0] == np.arange(order)).all()
    assert (times[1] == np.arange(order)).all()
    assert (np.sort(add, axis=1) == np.arange(order)).all()
    nonzero = np.arange(1, order)
    assert (times[nonzero, field.inverse[nonzero]] == 1).all()


def test_the_field_of_four_elements_is_the_known_one() -> None:
    assert galois_field(4).multiplication.tolist() == [[0, 0, 0, 0], [0, 1, 2, 3], [0, 2, 3, 1], [0, 3, 1, 2]]


def test_an_order_without_tables_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"\(2, 3, 4, 5, 7, 8, 9\); got 6"):
        galois_field(6)
