"""Makes sealed cases: SUMO runs, the log is written as a case, and the label is put away."""

import contextlib
import json
import multiprocessing
import os
import secrets
import shutil
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
from rich.progress import Progress

from experiments.blind_effects.drive import record_drive
from experiments.blind_effects.field_spec import FieldSpec
from experiments.blind_effects.manipulation import ManipulationCheck, Measures, manipulation_check
from experiments.blind_effects.plan import CALIBRATED, CasePlan, Size, draw_field, plan_cases
from experiments.blind_effects.raw_measures import raw_measures
from experiments.blind_effects.seal import Label, new_salt, root_of, seal_of
from experiments.blind_effects.sensors import logs
from experiments.blind_effects.traffic_files import scenario_config, scenario_demand, write_files
from experiments.roads.drawn_road import drawn_roads, find_road
from experiments.roads.road import Road

Logs = tuple[pd.DataFrame, pd.DataFrame, float | None]
DEPARTS_S = (0.0, 20.0, 40.0, 60.0, 80.0, 100.0)  # after the warm-up, in turn
HELD_OUT_EVERY = 3
SAME_TIME = (1_700_000_000, 1_700_000_000)  # of every file: its own would tell the order of making

MOST_ATTEMPTS, SEEDS_PER_ATTEMPT, FIRST_DRIVES = 8, 1000, 4


class NotStoodError(RuntimeError):
    """A vehicle that was to stand did not: traffic jammed before it, or it found no way to its lane."""


def make_drive(spec: FieldSpec, road_name: str, seed: int, depart_s: float) -> Logs:
    """Return the logs of one drive, and when a standing vehicle stood."""
    road = find_road(road_name)
    recording = record_drive(spec, road, seed, depart_s)
    return *logs(recording, road, spec.sensor, seed), recording.stood_s


def make_cases(
    out: Path,
    key_file: Path,
    size: Size,
    roads: tuple[str, ...],
    drawn: int,
    drives: int,
    checks: int,
    twins: int,
    jobs: int,
    first: int | None = None,
    kinds: tuple[str, ...] = (),
    draws_weights: bool = False,
) -> int:
    """Make the cases of a plan that are not there yet and return how many there are.

    With `first`, only so many of the plan: its order is random, so they are a sample of it, and a later call with more
    goes on. So many roads as `drawn` says are drawn instead of `roads`; the key's seed alone tells which. `kinds` and
    `draws_weights` are those of `plan_cases`.

    Raises:
        ValueError: the key lies where whoever diagnoses could read it, or belongs to another plan.
    """
    if out.resolve() in key_file.resolve().parents:
        raise ValueError(f"{key_file}: expected outside {out}, where the labels stay withheld.")
    settings: dict[str, Any] = {
        "size": size,
        "roads": list(roads),
        "drawn": drawn,
        "drives": drives,
        "checks": checks,
        "twins": twins,
    }
    if kinds or draws_weights:
        settings |= {"kinds": list(kinds), "draws_weights": draws_weights}
    key = _read(key_file) or {"seed": secrets.randbits(63), "settings": settings, "cases": {}}
    if key["settings"] != settings:
        raise ValueError(f"{key_file}: expected the key of this plan, it is of {key['settings']}.")
    _write(key_file, key)
    plans = plan_cases(size, roads or drawn_roads(drawn, key["seed"]), key["seed"], kinds, draws_weights)[:first]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool, Progress() as progress:
        task = progress.add_task("cases", total=len(plans))
        for plan in plans:
            if plan.name not in key["cases"]:
                label = make_case(plan, out, drives, checks, twins, pool)
                key["cases"][plan.name] = {"salt": new_salt(), "label": label}
                _write(key_file, key)
                seals = {name: seal_of(entry["salt"], entry["label"]) for name, entry in sorted(key["cases"].items())}
                _write(out / "seals.json", {"format": 1, "cases": seals, "root": root_of(seals)})
            progress.advance(task)
    return len(plans)


def make_case(plan: CasePlan, out: Path, drives: int, checks: int, twins: int, pool: Executor) -> Label:
    """Make one case and return its label; a field that traffic did not let happen is drawn again.

    Raises:
        NotStoodError: none of several fields happened.
    """
    for attempt in range(MOST_ATTEMPTS):
        with contextlib.suppress(NotStoodError):
            drawn_anew = replace(plan, seed=plan.seed + SEEDS_PER_ATTEMPT * attempt)
            return _make_case(drawn_anew, out, drives, checks, twins, pool)
    raise NotStoodError(f"{plan.name}: expected a field whose vehicle comes to stand, found none in {MOST_ATTEMPTS}.")


def _make_case(plan: CasePlan, out: Path, drives: int, checks: int, twins: int, pool: Executor) -> Label:
    road = find_road(plan.road)
    drawn = draw_field(plan)
    departs_s = [road.warmup_s + DEPARTS_S[number % len(DEPARTS_S)] for number in range(drives + twins)]
    seeds = [plan.seed + number for number in range(drives + twins)]
    runs = list(zip(seeds, departs_s, strict=True))
    if drawn.spec.standing:  # what cannot happen shows in the first drives
        first = [pool.submit(make_drive, drawn.spec, plan.road, *run) for run in runs[:FIRST_DRIVES]]
        _mean_stood_s([job.result()[2] for job in first])
    jobs = [pool.submit(make_drive, drawn.spec, plan.road, *run) for run in runs]
    num_checks = min(checks, drives) if drawn.spec != drawn.without else 0
    plain = [
        pool.submit(make_drive, drawn.without, plan.road, seeds[number], departs_s[number])
        for number in range(num_checks)
    ]
    made = [job.result() for job in jobs]
    label = drawn.label | {"num_drives": drives}
    if num_checks > 1:
        label["manipulation_check"] = dict(_checked(made[:num_checks], [job.result() for job in plain]))
    if drawn.spec.standing:
        _note_begin(label, [log[2] for log in made])
    roles = ["held_out" if (number + 1) % HELD_OUT_EVERY == 0 else "fit" for number in range(drives)]
    write_case(out / "cases" / plan.name, plan.name, road, made[:drives], departs_s, roles, plan.calibrated)
    if twins:
        more = roles + ["held_out"] * twins
        write_case(out / "twins" / plan.name, plan.name, road, made, departs_s, more, plan.calibrated)
    return label


def _note_begin(label: Label, stood_s: list[float | None]) -> None:
    """Put into the label when the vehicle came to stand, on average: traffic decides that, not the plan."""
    place = label["place_and_time"]
    place = place if "time_from_s" in place else place["blockage"]
    place["time_from_s"] = round(_mean_stood_s(stood_s), 1)


def _mean_stood_s(stood_s: list[float | None]) -> float:
    """Return when a vehicle came to stand, on average over drives.

    Raises:
        NotStoodError: in some drive it did not, before the subject vehicle was through.
    """
    known_s = [time_s for time_s in stood_s if time_s is not None]
    if len(known_s) < len(stood_s):
        raise NotStoodError(f"The vehicle that was to stand did not in {len(stood_s) - len(known_s)} drives.")
    return sum(known_s) / len(known_s)


def _checked(ours: list[Logs], theirs: list[Logs]) -> ManipulationCheck:
    with_effect: list[Measures] = [raw_measures(log[0], log[1]) for log in ours]
    without: list[Measures] = [raw_measures(log[0], log[1]) for log in theirs]
    changed = [not (one[0].equals(two[0]) and one[1].equals(two[1])) for one, two in zip(ours, theirs, strict=True)]
    return manipulation_check(with_effect, without, changed)


def write_case(
    folder: Path,
    name: str,
    road: Road,
    made: list[Logs],
    departs_s: list[float],
    roles: list[str],
    calibrated: tuple[str, ...] = CALIBRATED,
) -> None:
    """Write a case; what lies there from a run that was killed goes.

    Logs end where the scenario does, although in a jam the vehicle may still be on its way.
    """
    shutil.rmtree(folder, ignore_errors=True)
    write_files(folder / "scenario", [("scenario.sumocfg", scenario_config(road))])
    write_files(folder / "scenario", [("demand.rou.xml", scenario_demand(road))])
    shutil.copyfile(road.net_file, folder / "scenario" / "net.net.xml")
    (folder / "field").mkdir()
    for number, (subject, objects, _) in enumerate(made, start=1):
        subject, objects = (table[table["time_s"] <= road.duration_s] for table in (subject, objects))
        subject.to_parquet(folder / "field" / f"d{number:02d}_subject.parquet", index=False)
        objects.to_parquet(folder / "field" / f"d{number:02d}_objects.parquet", index=False)
    write_files(folder, [("case.toml", _case_toml(name, road, departs_s, roles, calibrated))])
    for file in folder.rglob("*"):
        os.utime(file, SAME_TIME)


def _case_toml(name: str, road: Road, departs_s: list[float], roles: list[str], calibrated: tuple[str, ...]) -> str:
    parameters = ", ".join(f'"{attribute}"' for attribute in calibrated)
    text = f"""format = 1
name = "{name}"

[scenario]
config     = "scenario/scenario.sumocfg"
warmup_s   = {road.warmup_s}
duration_s = {road.duration_s}
step_s     = 0.1

[subject]
vtype   = "subject"
vehicle = "ego"

[perception]
ahead_m   = 150.0
behind_m  = 150.0
reference = "front"
nominal_length_m = 4.8

[behaviour]
vtypes = ["car"]
car_following = "IDM"
parameters = [{parameters}]
"""
    for entrance in road.inputs_vehph:
        flows = ", ".join(f'"{flow.id}"' for flow in road.flows if flow.entrance == entrance)
        text += f'\n[[input]]\nid    = "{entrance}"\nflows = [{flows}]\n'
    for number, role in enumerate(roles, start=1):
        files = f"field/d{number:02d}"
        text += f'\n[[drive]]\nid       = "d{number:02d}"\ndepart_s = {departs_s[number - 1]}\n'
        text += f'subject  = "{files}_subject.parquet"\nobjects  = "{files}_objects.parquet"\nrole     = "{role}"\n'
    return text


def _read(file: Path) -> dict[str, Any] | None:
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None


def _write(file: Path, content: dict[str, Any]) -> None:
    """Write a file whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(f"{file.name}.part")
    part.write_text(json.dumps(content, indent=1), encoding="utf-8")
    part.replace(file)
