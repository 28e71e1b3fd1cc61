"""Sweeps: every row once, whatever happens on the way."""

import errno
import importlib
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from jaxcalib.cli import app as cli
from jaxcalib.cli.guarded import EXIT_SIMULATOR_FAILED
from jaxcalib.errors import CaseError, ResourceError
from jaxcalib.sweeps.report import report_files
from jaxcalib.sweeps.store import METADATA_KEY, SweepStore
from jaxcalib.sweeps.sweep import SweepResult, merge_shards, sweep
from sim_adapters.interface import Status
from tests.places import CORRIDOR

NUM_CANDIDATES, NUM_SEEDS = 100, 5  # 500 rows in 8 blocks, the last one short


def run(out: Path, **options) -> SweepResult:
    return sweep(CORRIDOR, out, **({"design": f"lhs:{NUM_CANDIDATES}", "seeds": NUM_SEEDS, "seed": 3} | options))


def assert_whole(table: pd.DataFrame) -> None:
    assert len(table) == NUM_CANDIDATES * NUM_SEEDS
    assert table["candidate"].tolist() == np.repeat(np.arange(NUM_CANDIDATES), NUM_SEEDS).tolist()
    assert table["seed"].tolist() == np.tile(3_000_000 + np.arange(NUM_SEEDS), NUM_CANDIDATES).tolist()


def test_a_row_holds_parameters_measures_and_how_the_run_went(toy, tmp_path: Path):
    out = tmp_path / "sweep.parquet"
    result = run(out)
    table = result.table()
    assert_whole(table)
    assert result.is_complete
    assert sum(result.statuses.values()) == 500
    failed = table[table["status"] == "COLLIDED"]
    assert 0 < len(failed) == result.statuses["COLLIDED"]
    assert failed["traffic_speed_mps"].isna().all()
    assert failed["num_observations_traffic_speed_mps"].isna().all()
    good = table[table["status"] == "OK"].iloc[0]
    assert good["num_observations_traffic_speed_mps"] > 100
    assert good["subject_speed_mps"] > 5
    assert (table["num_arrived"] == 1000).all()
    assert table["backlog_share"].to_numpy() == pytest.approx(0.002)
    assert set(table["depart_s"]) == {300.0, 320.0, 360.0, 380.0}
    assert table.groupby("candidate")["tau_s"].nunique().max() == 1
    assert not (tmp_path / "sweep.parquet.parts").exists()


def test_configuration_seeds_versions_and_commit_are_beside_it(toy, with_report, tmp_path: Path):
    out = tmp_path / "sweep.parquet"
    run(out)
    beside = json.loads((tmp_path / "sweep.json").read_text())
    within = json.loads(pq.read_schema(out).metadata[METADATA_KEY])
    for found in (beside, within):
        assert found["seeds"] == [3_000_000, 3_000_004]
        assert found["design"] == "lhs:100"
        assert found["parameters"]["tau"]["unit"] == "s"
        assert found["versions"]["jax"]
        assert "commit" in found
    schema = pq.read_schema(out)
    assert schema.field("tau_s").metadata[b"unit"] == b"s"
    page = (tmp_path / "sweep.html").read_text()
    assert "<svg" in page
    assert "<script" not in page


@settings(max_examples=5, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(stops=st.lists(st.integers(0, 5), max_size=4))
def test_a_stopped_sweep_goes_on_and_ends_as_if_it_had_not_been(toy: Callable, tmp_path: Path, stops: list[int]):
    whole = tmp_path / "whole.parquet"
    toy()
    run(whole)
    with TemporaryDirectory(dir=tmp_path) as folder:
        out, made = Path(folder) / "sweep.parquet", 0
        for stop in stops:
            if made + stop >= 8:
                break
            engines = toy(stop_before=stop)
            with pytest.raises(KeyboardInterrupt):
                run(out)
            made += stop
            assert engines[-1].is_closed
            assert not out.exists()
            if made:  # what is there can be read meanwhile
                assert len(pd.read_parquet(out.with_name("sweep.parquet.parts"))) == 64 * made
        engines = toy()
        result = run(out)
        assert engines[-1].made == 8 - made
        assert result.num_made == 500 - 64 * made
        pd.testing.assert_frame_equal(result.table(), pd.read_parquet(whole))


def test_a_complete_sweep_is_not_made_again(toy: Callable, tmp_path: Path):
    out = tmp_path / "sweep.parquet"
    run(out)
    before = out.read_bytes()
    num_engines = len(toy())
    result = run(out, resume=True)
    assert result.is_complete
    assert result.num_made == 0
    assert len(toy()) == num_engines  # no other was asked for
    assert out.read_bytes() == before


def test_a_report_that_a_kill_left_out_is_written_by_the_next_call(
    toy: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    out, written = tmp_path / "sweep.parquet", []
    run(out)

    def write(table: Path, problem: object) -> None:
        written.append(table)
        for file in report_files(table):
            file.touch()

    monkeypatch.setattr(importlib.import_module("jaxcalib.sweeps.sweep"), "write_report", write)
    assert run(out, resume=True).num_made == 0
    assert run(out, resume=True).num_made == 0
    assert written == [out]


@pytest.mark.parametrize("status", [Status.FAILED, Status.COLLIDED])
def test_a_sweep_of_which_every_run_failed_says_so(
    status: Status, toy: Callable, with_report: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """Code 3 and the first failure's words in one line; the table is kept."""
    toy(status_of=lambda request: status)
    out = tmp_path / "sweep.parquet"
    words = "words of seed 3000000" if status is Status.FAILED else "vehicles overlapped for a longer time"
    line = f"jaxcalib: all 8 runs failed (8 {status.name}), see {out}. {words}\n"

    def command(**more) -> int:
        options = {"design": "lhs:4", "seeds": 2, "seed": 3, "quiet": True} | more
        return cli.sweep(CORRIDOR, out=out, **options)

    for more in ({}, {"resume": True}, {"merge": True}):
        assert command(**more) == EXIT_SIMULATOR_FAILED
        assert capsys.readouterr().err == line
        assert len(pd.read_parquet(out)) == 8
    out.unlink()
    assert command(shard="1/1") == 0  # a job need not be all of the sweep
    assert command(merge=True) == EXIT_SIMULATOR_FAILED


def test_a_sweep_of_which_a_run_succeeded_is_done(toy: Callable, tmp_path: Path):
    toy(status_of=lambda request: Status.OK if request.seed == 3_000_001 else Status.FAILED)
    assert cli.sweep(CORRIDOR, out=tmp_path / "sweep.parquet", design="lhs:4", seeds=2, seed=3, quiet=True) == 0


def test_jobs_share_a_folder_and_merging_checks_that_nothing_is_missing(toy, tmp_path: Path):
    whole, out = tmp_path / "whole.parquet", tmp_path / "sweep.parquet"
    run(whole)
    for shard in ("3/3", "1/3"):
        result = run(out, shard=shard)
        assert not out.exists()
        assert not result.is_complete
    assert result.num_missing == 2 * 64 + 52
    with pytest.raises(CaseError, match=re.escape("180 are missing: blocks 1, 4, 7 of 8 (shards 2 of 3)")):
        merge_shards(out, CORRIDOR)
    assert not out.exists()
    run(out, shard="2/3")
    result = merge_shards(out, CORRIDOR)
    assert result.is_complete
    pd.testing.assert_frame_equal(result.table(), pd.read_parquet(whole))
    assert merge_shards(out).num_rows == 500  # once more does no harm


def test_a_sweep_finishes_what_shards_have_left(toy: Callable, tmp_path: Path):
    out = tmp_path / "sweep.parquet"
    run(out, shard="1/2")
    engines = toy()
    assert_whole(run(out).table())
    assert engines[-1].made == 4


def test_a_job_at_work_is_not_disturbed(toy: Callable, tmp_path: Path):
    out = tmp_path / "sweep.parquet"
    toy(stop_before=1)
    with pytest.raises(KeyboardInterrupt):
        run(out, shard="1/2")
    toy()
    from jaxcalib.sweeps.plan import Shard

    with SweepStore(out) as other:
        other.claim(Shard(1, 2))
        with pytest.raises(CaseError, match="another job"):
            run(out, shard="1/2")
        with pytest.raises(CaseError, match="same number of shards"):
            run(out, shard="1/3")
        with pytest.raises(CaseError, match="shard 1/2 is at work"):
            merge_shards(out)
        run(out, shard="2/2")
    run(out, shard="1/2")
    assert_whole(merge_shards(out).table())


def test_a_damaged_block_is_made_again(toy: Callable, tmp_path: Path):
    out = tmp_path / "sweep.parquet"
    run(out, shard="1/2")
    blocks = sorted((tmp_path / "sweep.parquet.parts").glob("block-*.parquet"))
    blocks[0].write_bytes(blocks[0].read_bytes()[:-20])
    blocks[1].write_bytes(b"")
    engines = toy()
    assert_whole(run(out).table())
    assert engines[-1].made == 6


def test_a_full_disk_is_said_and_nothing_is_lost(toy: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    out = tmp_path / "sweep.parquet"
    synced = []

    def fsync(descriptor: int) -> None:
        synced.append(descriptor)
        if len(synced) == 5:  # the description and three blocks are written
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", fsync)
    with pytest.raises(ResourceError, match=r"No space left on device.*give the same command again"):
        run(out)
    assert len(pd.read_parquet(tmp_path / "sweep.parquet.parts")) == 3 * 64
    engines = toy()
    assert_whole(run(out).table())
    assert engines[-1].made == 5


def test_a_disk_that_is_full_while_merging(toy: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from jaxcalib.sweeps import merge

    out = tmp_path / "sweep.parquet"
    with monkeypatch.context() as patch:

        def full(*arguments: object) -> int:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        patch.setattr(merge, "_write", full)
        with pytest.raises(ResourceError):
            run(out)
    assert not out.exists()
    toy()
    assert_whole(run(out).table())


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"seeds": 4}, "options"),
        ({"design": "lhs:101"}, "options"),
        ({"seed": 4}, "options"),
        ({"engine": "sumo"}, "options"),
        ({"parameters": ["tau"]}, "options"),
    ],
)
def test_a_sweep_of_other_options_is_refused(toy: Callable, tmp_path: Path, options: dict, says: str):
    out = tmp_path / "sweep.parquet"
    run(out, shard="1/2")
    with pytest.raises(CaseError, match=f"_sweep.json: {says}: expected the options"):
        run(out, **options)


@pytest.mark.parametrize("part", ["case", "program"])
@pytest.mark.parametrize("is_complete", [True, False])
def test_a_sweep_of_another_case_or_version_is_refused(toy: Callable, tmp_path: Path, part: str, is_complete: bool):
    out = tmp_path / "sweep.parquet"
    run(out, shard=None if is_complete else "1/2")
    if is_complete:
        table = pq.read_table(out)
        found = json.loads(table.schema.metadata[METADATA_KEY])
        found["identity"][part] = "elsewhere 123"
        pq.write_table(table.replace_schema_metadata({METADATA_KEY: json.dumps(found)}), out)
    else:
        file = tmp_path / "sweep.parquet.parts" / "_sweep.json"
        found = json.loads(file.read_text())
        found["identity"][part] = "elsewhere 123"
        file.write_text(json.dumps(found))
    with pytest.raises(CaseError, match=f"{part}: expected the (case|version)"):
        run(out)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("sweep.parquet", b"not a table", "expected the table of a sweep"),
        ("sweep.parquet.parts/other.txt", b"", "expected an empty folder"),
        ("sweep.parquet.parts/_sweep.json", b"[]", "cannot be read"),
        ("sweep.parquet.parts/_sweep.json", b"{", "cannot be read"),
        ("sweep.parquet.parts", b"", "expected a folder"),
        ("sweep.parquet/folder", b"", "got a folder"),
    ],
)
def test_what_is_in_the_way_is_left_alone(toy: Callable, tmp_path: Path, name: str, content: bytes, says: str):
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CaseError, match=re.escape(says)):
        run(tmp_path / "sweep.parquet")
    assert (tmp_path / name).read_bytes() == content


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"shard": "0/3"}, "--shard"),
        ({"shard": "4/3"}, "--shard"),
        ({"shard": "1"}, "--shard"),
        ({"engine": "vissim"}, "--engine"),
        ({"seeds": 0}, "--seeds"),
        ({"seed": 2001}, "--seed"),
        ({"resume": True}, "none"),
    ],
)
def test_options_that_are_refused(toy: Callable, tmp_path: Path, options: dict, says: str):
    with pytest.raises(CaseError, match=says):
        run(tmp_path / "sweep.parquet", **options)
    assert not list(tmp_path.iterdir())


def test_names_and_places_that_are_refused(toy: Callable, tmp_path: Path):
    with pytest.raises(CaseError, match=r"ends in \.parquet"):
        run(tmp_path / "sweep.csv")
    with pytest.raises(CaseError, match="outside the case"):
        run(CORRIDOR / "sweep.parquet")
    with pytest.raises(CaseError, match="there is none"):
        merge_shards(tmp_path / "sweep.parquet")
