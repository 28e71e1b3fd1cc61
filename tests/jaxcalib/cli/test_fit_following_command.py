"""`jaxcalib fit-following` from the outside."""

import json
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from tests.jaxcalib.pair_fitting.pairs import table


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "jaxcalib", "fit-following", *arguments], capture_output=True, text=True
    )


@pytest.mark.long
def test_pairs_in_tables_out(tmp_path: Path) -> None:
    pairs = pd.concat([table(), table(pair_id="b"), table(pair_id="c", gap_m=-1.0)])
    pairs.to_csv(tmp_path / "pairs.csv", index=False)
    done = run(str(tmp_path / "pairs.csv"), "--out", str(tmp_path / "out"), "--model", "IIDM", "--drop-bad-pairs",
               "--held-out-share", "0.4")  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = pd.read_csv(tmp_path / "out" / "pairs.csv")
    assert rows["pair_id"].tolist() == ["a", "b"]
    assert (rows["mixed_error"] < 0.2).all()
    assert rows["mixed_error_held_out"].notna().all()
    population = json.loads((tmp_path / "out" / "population.json").read_text(encoding="utf-8"))
    assert (population["model"], population["num_pairs"], len(population["dropped"])) == ("iidm", 2, 1)


def test_a_model_that_does_not_exist_ends_with_2_and_the_known_ones(tmp_path: Path) -> None:
    done = run(str(tmp_path / "pairs.csv"), "--out", str(tmp_path / "out"), "--model", "idem")
    assert done.returncode == 2
    assert "idm, iidm, acc" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_bad_pairs_end_with_2_and_one_line(tmp_path: Path) -> None:
    table(gap_m=-1.0).to_csv(tmp_path / "pairs.csv", index=False)
    done = run(str(tmp_path / "pairs.csv"), "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert 'pair "a", row 2, column gap_m: expected a gap above 0' in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
