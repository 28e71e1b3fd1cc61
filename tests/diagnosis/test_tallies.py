"""Tallies of drives made in two parts are those of drives made at once."""

import numpy as np

from jaxcalib.diagnosis.features import Cell, TallyBook, gather_tallies, joined_tallies

SPEED, GAP, NOISE = (Cell("closed_loop", name) for name in ("speed_mps", "gap_s", "noise"))


def book(speed: float, gap: float | None = None, noise: float | None = None) -> TallyBook:
    one = TallyBook()
    one.quotient(SPEED, speed, 2.0)
    if gap is not None:
        one.quotient(GAP, gap, 3.0)
    if noise is not None:
        one.quotient(NOISE, noise, 5.0)
    return one


def test_parts_together_are_the_whole_whatever_each_of_them_lacks():
    books, departs = [book(1.0, 2.0), book(4.0), book(7.0, noise=0.5)], [300.0, 320.0, 340.0]
    whole = gather_tallies(books, departs)
    for cut in range(4):
        joined = joined_tallies(gather_tallies(books[:cut], departs[:cut]), gather_tallies(books[cut:], departs[cut:]))
        place = [joined.cells.index(cell) for cell in whole.cells]
        assert len(joined.cells) == len(whole.cells)
        np.testing.assert_array_equal(joined.above[:, place], whole.above)
        np.testing.assert_array_equal(joined.below[:, place], whole.below)
        np.testing.assert_array_equal(joined.depart_s, whole.depart_s)
