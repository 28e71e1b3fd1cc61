"""Arithmetic of the small finite fields GF(q) that orthogonal arrays are built over, as lookup tables."""

import functools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

# order q = p^n: (p, n, coefficients c_0 ... c_{n-1} with x^n = c_0 + c_1 x + ... in GF(q))
_REDUCTIONS: dict[int, tuple[int, int, tuple[int, ...]]] = {
    2: (2, 1, (0,)),
    3: (3, 1, (0,)),
    4: (2, 2, (1, 1)),  # x^2 = x + 1
    5: (5, 1, (0,)),
    7: (7, 1, (0,)),
    8: (2, 3, (1, 1, 0)),  # x^3 = x + 1
    9: (3, 2, (2, 0)),  # x^2 = -1
}

FIELD_ORDERS: tuple[int, ...] = tuple(_REDUCTIONS)


@dataclass(frozen=True)
class GaloisField:
    """Tables of GF(q); an element is the number whose base-p digits are its polynomial coefficients."""

    order: int  # number of elements q
    addition: Int[np.ndarray, "order order"]  # sum of two elements
    multiplication: Int[np.ndarray, "order order"]  # product of two elements
    inverse: Int[np.ndarray, " order"]  # multiplicative inverse; entry 0 is 0 and has no meaning


def _digits(element: int, base: int, num_digits: int) -> list[int]:
    return [element // base**position % base for position in range(num_digits)]


def _number(digits: list[int], base: int) -> int:
    return sum(digit * base**position for position, digit in enumerate(digits))


def _product(left: list[int], right: list[int], base: int, reduction: tuple[int, ...]) -> list[int]:
    degree = len(left)
    result = [0] * (2 * degree - 1)
    for i, a in enumerate(left):
        for j, b in enumerate(right):
            result[i + j] = (result[i + j] + a * b) % base
    for power in range(2 * degree - 2, degree - 1, -1):
        for offset, coefficient in enumerate(reduction):
            position = power - degree + offset
            result[position] = (result[position] + result[power] * coefficient) % base
    return result[:degree]


@functools.cache
def galois_field(order: int) -> GaloisField:
    """Return the tables of GF(order).

    Args:
        order: one of `FIELD_ORDERS` (2, 3, 4, 5, 7, 8, 9).

    Raises:
        ValueError: there are no tables for this order.

    Source: Lidl & Niederreiter, Finite Fields, ch. 1-2 (residues modulo an irreducible polynomial).
    """
    if order not in _REDUCTIONS:
        raise ValueError(f"Expected a field order among {FIELD_ORDERS}; got {order}.")
    base, degree, reduction = _REDUCTIONS[order]
    elements = [_digits(element, base, degree) for element in range(order)]
    addition = np.array(
        [[_number([(a + b) % base for a, b in zip(x, y, strict=True)], base) for y in elements] for x in elements]
    )
    multiplication = np.array([[_number(_product(x, y, base, reduction), base) for y in elements] for x in elements])
    inverse = np.argmax(multiplication == 1, axis=1)
    for table in (addition, multiplication, inverse):
        table.setflags(write=False)
    return GaloisField(order, addition, multiplication, inverse)
