"""Tallies of drives that were made in parts, or several in one run."""

import numpy as np
import pytest

from jaxcalib.diagnosis.features.features import Cell, Channel, DriveTallies, TallyBook, gather_tallies, joined_tallies

SPEED, GAP, NOISE = (Cell(Channel.CLOSED_LOOP, name) for name in ("speed_mps", "gap_s", "noise"))


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


def test_drives_of_one_run_are_worth_as_many_as_they_tell_apart():
    random = np.random.default_rng(3)
    num_runs, per_run, cells = 40, 3, tuple(Cell(Channel.CLOSED_LOOP, f"feature_{k}") for k in range(60))
    run = np.repeat(np.arange(num_runs) + 7, per_run)

    def worth(common: float) -> float:
        shared = np.repeat(random.normal(size=(num_runs, len(cells))), per_run, axis=0)
        own = random.normal(size=shared.shape)
        above = 9.0 + np.sqrt(common) * shared + np.sqrt(1.0 - common) * own
        return DriveTallies(cells, above, np.ones_like(above), np.zeros(len(run)), run).num_independent

    assert worth(0.0) == pytest.approx(num_runs * per_run, rel=0.1)
    assert worth(0.5) == pytest.approx(num_runs * per_run / 2.0, rel=0.1)  # 1 + (3 - 1) / 2 times the variance
    assert worth(1.0) == pytest.approx(num_runs)
    alone = DriveTallies(cells, np.ones((5, 60)), np.ones((5, 60)), np.zeros(5))
    assert alone.num_independent == alone.num_runs == 5


def test_joined_drives_keep_their_runs_apart():
    departs = [300.0, 340.0, 320.0]
    one = gather_tallies([book(1.0), book(2.0), book(3.0)], departs, [0, 0, 1])
    other = gather_tallies([book(1.0), book(2.0), book(3.0)], departs, [0, 1, 1])
    joined = joined_tallies(one, other)
    assert joined.num_runs == 4
    assert list(joined.run) == [0, 0, 1, 2, 3, 3]
    assert joined_tallies(one, gather_tallies([book(1.0)], [300.0])).num_runs == 3
    assert joined_tallies(*(gather_tallies([book(1.0)], [300.0]) for _ in range(2))).run is None
    assert joined.take([0, 1, 4]).num_runs == 2
