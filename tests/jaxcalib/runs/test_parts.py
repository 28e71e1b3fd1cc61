"""Parts of a work: whole or not there, and made again where they are damaged."""

import json
from pathlib import Path

import pytest

from jaxcalib.errors import CaseError
from jaxcalib.runs.parts import Parts


def load(file: Path) -> list[int]:
    return json.loads(file.read_text())


def test_a_part_is_read_as_it_was_written_and_names_are_in_order(tmp_path: Path) -> None:
    parts = Parts.begin(tmp_path / "deep" / "parts")
    for name, text in (("b.json", b"[3, 4]"), ("a.json", b"[1, 2]"), ("other.npz", b"")):
        parts.write(name, lambda stream, text=text: stream.write(text))
    assert Parts(parts.folder).read("b.json", load) == [3, 4]
    assert parts.names("*.json") == ["a.json", "b.json"]


@pytest.mark.parametrize("damaged", [b"", b"[1, ", b"\xff\xfe"])
def test_a_damaged_part_is_taken_away_so_that_it_is_made_again(tmp_path: Path, damaged: bytes) -> None:
    parts = Parts.begin(tmp_path)
    parts.write("a.json", lambda stream: stream.write(damaged))
    parts.write("b.json", lambda stream: stream.write(b"[5]"))
    assert parts.read("a.json", load) is None
    assert parts.names("*.json") == ["b.json"]
    parts.write("a.json", lambda stream: stream.write(b"[6]"))
    assert parts.read("a.json", load) == [6]


def test_a_write_that_breaks_off_leaves_the_part_that_was_there_and_nothing_else(tmp_path: Path) -> None:
    parts = Parts.begin(tmp_path)
    parts.write("a.json", lambda stream: stream.write(b"[7]"))

    def breaks_off(stream) -> None:
        stream.write(b"[8")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        parts.write("a.json", breaks_off)
    assert parts.read("a.json", load) == [7]
    assert [file.name for file in tmp_path.iterdir()] == ["a.json"]


def test_what_a_kill_leaves_is_no_part(tmp_path: Path) -> None:
    (tmp_path / ".a.json.0a1b2c.draft").write_text("[1")
    (tmp_path / ".b.json").write_text("[1]")
    assert Parts(tmp_path).names("*") == []


def test_a_folder_that_is_gone_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match="can be written to"):
        Parts(tmp_path / "gone").write("a.json", lambda stream: stream.write(b"[1]"))


def test_a_part_that_was_never_made_is_none_and_a_fault_of_the_reader_is_not_damage(tmp_path: Path) -> None:
    parts = Parts.begin(tmp_path)
    assert parts.read("a.json", load) is None
    parts.write("a.json", lambda stream: stream.write(b"[1]"))
    with pytest.raises(ZeroDivisionError):
        parts.read("a.json", lambda file: 1 // 0)
    assert parts.read("a.json", load) == [1]
