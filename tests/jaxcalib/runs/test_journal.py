from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jaxcalib.runs.journal import Journal
from sim_adapters.atomic_file import write_atomically
from sim_adapters.interface import NO_DRIVE, RunOutcome, RunRequest, Status
from surrogate.effects.base import EffectSetting


def outcome(seed: int, status: Status = Status.OK) -> RunOutcome:
    observed = np.asarray([0.1 * seed, np.pi, -3.0], np.float32) if status.is_ok else None
    request = RunRequest((1234.5, 0.1 + seed / 3.0), seed, 320.0, drive=7 if seed == 2 else NO_DRIVE)
    return RunOutcome(
        request, status, observed, np.asarray([7, 2]), np.asarray([6, 2]), 3, 1, 5 * seed, 99, seed != 3, 0.25,
        "" if status.is_ok else "end",
    )  # fmt: skip


def test_what_was_added_is_found_again_bit_for_bit(tmp_path: Path):
    made = [outcome(1), outcome(2, Status.COLLIDED), outcome(3)]
    Journal(tmp_path / "journal").add("surrogate", made, 1.5)
    again = Journal(tmp_path / "journal")
    before = again.clock()
    for one in made:
        found = again.find("surrogate", one.request)
        assert found is not None
        assert found.status is one.status
        assert found.request == one.request
        assert found.log_tail == one.log_tail
        assert found.subject_left is (one.request.seed != 3)
        assert found.num_subject_overlaps == one.num_subject_overlaps == 5 * one.request.seed
        if one.observed is None:
            assert found.observed is None
        else:
            assert np.array_equal(found.observed, one.observed)
    assert again.clock() - before == pytest.approx(1.5, abs=0.2)  # each run counts once
    assert again.find("surrogate", made[0].request) is not None
    assert again.clock() - before == pytest.approx(1.5, abs=0.2)
    assert again.find("sumo", made[0].request) is None
    assert again.find("surrogate", replace(made[1].request, drive=NO_DRIVE)) is None
    assert again.find("surrogate", replace(made[0].request, drive=7)) is None


def test_a_run_whose_simulator_died_is_made_again_by_whoever_resumes(tmp_path: Path):
    journal = Journal(tmp_path / "journal")
    journal.add("sumo", [outcome(1, Status.FAILED), outcome(2)], 1.0)
    journal.add("sumo", [outcome(3, Status.FAILED)], 1.0)
    assert journal.find("sumo", outcome(1).request) is not None
    again = Journal(tmp_path / "journal")
    assert [again.find("sumo", outcome(seed).request) is not None for seed in (1, 2, 3)] == [False, True, False]


def test_a_damaged_part_is_dropped_and_the_others_stay(tmp_path: Path):
    journal = Journal(tmp_path / "journal")
    journal.add("sumo", [outcome(1)], 1.0)
    journal.add("sumo", [outcome(2)], 1.0)
    first, second = sorted((tmp_path / "journal").glob("part-*.npz"))
    content = first.read_bytes()
    first.write_bytes(content[: len(content) // 2])
    again = Journal(tmp_path / "journal")
    assert again.find("sumo", outcome(1).request) is None
    assert again.find("sumo", outcome(2).request) is not None
    assert not first.exists()
    assert second.exists()


@pytest.mark.parametrize("part", range(12))
def test_a_flipped_byte_is_never_a_wrong_number(tmp_path: Path, part: int):
    journal = Journal(tmp_path / "journal")
    journal.add("sumo", [outcome(1)], 1.0)
    (file,) = (tmp_path / "journal").glob("part-*.npz")
    content = bytearray(file.read_bytes())
    content[len(content) * part // 12] ^= 0x10
    file.write_bytes(bytes(content))
    found = Journal(tmp_path / "journal").find("sumo", outcome(1).request)
    assert found is None or np.array_equal(found.observed, outcome(1).observed)


def test_a_write_that_breaks_off_leaves_what_was_there(tmp_path: Path):
    file = tmp_path / "result.json"
    file.write_text("old")

    def breaks_off(stream) -> None:
        stream.write(b"half")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_atomically(file, breaks_off)
    assert file.read_text() == "old"
    assert [one.name for one in tmp_path.iterdir()] == ["result.json"]


def test_a_run_with_an_effect_is_another_run(tmp_path: Path):
    plain = outcome(1)
    slow, slower = ({"slow_start": EffectSetting(strength)} for strength in (0.2, 0.3))
    made = replace(plain, request=replace(plain.request, effects=slow), num_arrived=np.asarray([5, 1]))
    Journal(tmp_path / "journal").add("surrogate", [plain, made], 1.0)
    again = Journal(tmp_path / "journal")
    found = again.find("surrogate", made.request)
    assert found is not None
    assert found.request == made.request
    assert found.num_arrived.tolist() == [5, 1]
    without = again.find("surrogate", plain.request)
    assert without is not None
    assert without.num_arrived.tolist() == [7, 2]
    assert again.find("surrogate", replace(plain.request, effects=slower)) is None
