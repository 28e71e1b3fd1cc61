"""Nobody is lost in the queue of runs, and those that outlast their batch go on together."""

from hypothesis import given
from hypothesis import strategies as st

from sim_adapters.jax.run_queue import Going, RunQueue


def drive(durations: list[int], batch: int) -> list[list[tuple[int, int]]]:
    """Return the batches, each of (number, time left before) of its runs, of runs that last so long."""
    queue = RunQueue(range(len(durations)), batch)
    left = dict(enumerate(durations))
    batches = []
    while runs := queue.take():
        batches.append([(run.number, left[run.number]) for run in runs])
        most_left = int(queue.share_left * len(runs))
        lasts = sorted((left[run.number] for run in runs), reverse=True)[most_left]
        for run in runs:
            run.state = "somewhere"
            left[run.number] = max(0, left[run.number] - lasts)
            if left[run.number]:
                queue.put_back(run)
    assert not any(left.values())
    return batches


@given(durations=st.lists(st.integers(1, 20), max_size=60), batch=st.integers(1, 9))
def test_every_run_ends_and_no_batch_is_too_large(durations: list[int], batch: int) -> None:
    batches = drive(durations, batch)
    assert all(0 < len(runs) <= batch for runs in batches)
    begun = [number for runs in batches for number, left in runs if left == durations[number]]
    assert sorted(begun) == list(range(len(durations)))  # each begins once


def test_the_last_batch_is_driven_to_its_end() -> None:
    queue = RunQueue([4, 7], 3)
    assert [run.number for run in queue.take()] == [4, 7]
    assert queue.share_left == 0.0
    assert queue.take() == []


def test_interrupted_runs_wait_until_they_fill_a_batch_or_nobody_else_is_left() -> None:
    queue = RunQueue(range(5), 2)
    first = queue.take()
    assert queue.share_left > 0.0
    queue.put_back(first[0])
    second = queue.take()
    assert [run.number for run in second] == [2, 3]
    queue.put_back(second[1])
    assert [run.number for run in queue.take()] == [0, 3]  # they fill one: before the one that has not begun
    assert [run.number for run in queue.take()] == [4]


def test_a_place_that_no_new_run_needs_is_given_to_an_interrupted_one() -> None:
    queue = RunQueue([0], 2)
    queue.put_back(Going(9, "somewhere"))
    assert [run.number for run in queue.take()] == [0, 9]


def test_four_long_runs_do_not_keep_four_batches_waiting() -> None:
    durations = [10, 20, 10, 10] * 4
    batches = drive(durations, 4)
    assert len(batches) == 5
    assert [left for _, left in batches[-1]] == [10, 10, 10, 10]
