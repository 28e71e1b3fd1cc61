"""Folders that are sent along come out as they went in."""

from pathlib import Path

from jaxcalib.cluster.archive import packed, unpack


def test_a_folder_comes_out_as_it_went_in(tmp_path: Path):
    folder, again = tmp_path / "folder", tmp_path / "again"
    (folder / "deep" / "er").mkdir(parents=True)
    (folder / "a b.xml").write_text("<a/>\n")
    (folder / "deep" / "er" / "numbers.bin").write_bytes(bytes(range(256)) * 3)
    unpack(packed(folder), again)
    files = {file.relative_to(again): file.read_bytes() for file in again.rglob("*") if file.is_file()}
    assert files == {Path("a b.xml"): b"<a/>\n", Path("deep/er/numbers.bin"): bytes(range(256)) * 3}
