"""One SUMO run in a process of its own: libsumo holds one simulation per process, and may take the process with it."""

import csv
import ctypes
import os
import pickle
import re
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from sim_adapters.sumo.distant import TypeSwitch
from sim_adapters.sumo.job import LOG_FILE, SumoFailedError, SumoJob, SumoRun

COPY = ".copy"  # in ids of vehicles that stand twice where demand is scaled up
PR_SET_PDEATHSIG = 1  # of Linux's prctl
STANDARD_ERROR = 2
SAYS_NOTHING = "Process Error"  # SUMO's exception where it has said the reason on standard error before

os.environ.setdefault("LIBSUMO_AS_TRACI", "quiet")  # no warning about the version of pyarrow, which is not used here


def begin_worker() -> None:
    """End with the parent, however that ends."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    os.environ["JAX_PLATFORMS"] = "cpu"  # a driver's few numbers are no work for an accelerator, which has one owner


class TruncatedOutputError(RuntimeError):
    """SUMO's output ends early; it says nothing when a disk is full."""


def packed_run(run: Callable[[SumoJob], SumoRun], job: SumoJob) -> bytes:
    """Make a run and pack it; what cannot be packed ends here in one line, and not the process that would send it.

    Args:
        run: makes it.
        job: what there is to do.

    Raises:
        SumoFailedError: the answer cannot be sent to another process.
    """
    answer = run(job)
    try:
        return pickle.dumps(answer, pickle.HIGHEST_PROTOCOL)
    except (pickle.PicklingError, AttributeError, TypeError):
        raise SumoFailedError(f"a worker answered with a {type(answer).__name__} that cannot be sent") from None


def run_job(job: SumoJob) -> SumoRun:
    """Make a run and read its output.

    Raises:
        SumoFailedError: SUMO ended by itself; what else it said is in the run's log.
        TruncatedOutputError: the output lacks frames.
    """
    import time

    import libsumo

    began, began_cpu = time.perf_counter(), time.process_time()
    output = job.folder / "frames.csv"
    arguments = [
        "sumo",
        *("-c", str(job.config), "--net-file", str(job.net_file), "--seed", str(job.seed)),
        *("--no-step-log", "true", "--duration-log.disable", "true", "--no-warnings", "true"),
        *("--fcd-output", str(output), "--precision", "6"),
        *("--device.fcd.explicit", job.subject_vehicles[0], "--device.fcd.radius", str(job.radius_m)),
        *("--device.fcd.period", str(job.frame_interval_s), "--fcd-output.acceleration", "true"),
        *("--fcd-output.attributes", "id,lane,pos,speed,acceleration,posLat"),
    ]
    if job.control is not None:
        arguments += ["--collision.action", "warn"]  # SUMO would take a vehicle away that a log leads into another
    try:
        with standard_error_in(job.folder / LOG_FILE):
            libsumo.start(arguments)
            try:
                counts = _step_until_subject_left(libsumo, job)
            finally:
                libsumo.close()
    except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
        raise SumoFailedError(str(error).removeprefix(SAYS_NOTHING)) from None
    frames = _read_frames(output, job)
    found = int(np.sum(frames["vehicle"] < 0))
    if found != counts["num_frames"]:
        raise TruncatedOutputError(
            f"expected {counts['num_frames']} frames of subject vehicles in SUMO's output, found {found}; disk full?"
        )
    del counts["num_frames"]
    return SumoRun(**frames, **counts, wall_s=time.perf_counter() - began, cpu_s=time.process_time() - began_cpu)


_said: set[bytes] = set()  # lines without their numbers, by this process


def _not_said_yet(text: bytes) -> bytes:
    """Lines of a kind that was not said yet: of thousands of vehicles the same is said in every run."""
    new = {re.sub(rb"[\d.]+", b"#", line): line for line in reversed(text.splitlines(keepends=True))}
    lines = [line for kind, line in reversed(new.items()) if kind not in _said]
    _said.update(new)
    return b"".join(lines)


@contextmanager
def standard_error_in(file: Path) -> Iterator[None]:
    """Keep in a file what this process, SUMO's C++ included, says on standard error; even the last words of a crash.

    SUMO's option --error-log would leave those out, and say the others to the user's terminal as well. There they are
    said only where SUMO goes on in spite of them.
    """
    before = os.dup(STANDARD_ERROR)
    try:
        with file.open("ab") as log:
            os.dup2(log.fileno(), STANDARD_ERROR)
        yield
        with suppress(OSError):  # nobody reads it
            os.write(before, _not_said_yet(file.read_bytes()))
    finally:
        os.dup2(before, STANDARD_ERROR)
        os.close(before)


def _step_until_subject_left(libsumo, job: SumoJob) -> dict:
    simulation, vehicles = libsumo.simulation, libsumo.vehicle
    inserted = np.zeros(job.num_entrances, int)
    num_collisions = num_overlaps = num_teleports = num_vehicle_steps = num_frames = 0
    step_s = simulation.getDeltaT()
    steps_per_frame = max(1, round(job.frame_interval_s / step_s))
    to_come, on_the_way = set(job.subject_vehicles), set()
    has_left = False
    passed: dict[str, list[float]] = {edge: [] for edge in job.counted_edges}
    on_edge: dict[str, set[str]] = {edge: set() for edge in job.counted_edges}
    driver = None
    if job.control is not None:
        from sim_adapters.sumo.driver import driver_of

        driver = driver_of(libsumo, job.control, job)
    switch = None
    if job.distant is not None:
        switch = TypeSwitch(libsumo, job.distant, job.subject_vehicles[0], job.radius_m, job.lane_place)
    for step in range(round(simulation.getTime() / step_s), round(job.end_s / step_s)):
        if switch is not None and not has_left:
            switch.before_step(step)
        if driver is not None and not has_left:
            if to_come and driver.enters(step):
                on_the_way, to_come = to_come, set()
            has_left = bool(on_the_way) and not driver.before_step(step)
            if has_left and not job.counted_edges:
                break
        libsumo.simulationStep()
        if switch is not None:
            switch.departed(simulation.getDepartedIDList())
        for departed in simulation.getDepartedIDList():
            entrance = _entrance_of(departed, job.entrance_of_flow)
            if entrance is not None:
                inserted[entrance] += 1
            if departed in to_come:
                to_come.remove(departed)
                on_the_way.add(departed)
        num_collisions += simulation.getCollidingVehiclesNumber()
        if driver is not None:
            num_overlaps += job.subject_vehicles[0] in simulation.getCollidingVehiclesIDList()
        num_teleports += simulation.getStartingTeleportNumber()
        if on_the_way and (lost := on_the_way.intersection(simulation.getStartingTeleportIDList())):
            raise SumoFailedError(
                f"SUMO teleported subject vehicle '{min(lost)}', which had stood for longer than time-to-teleport: no "
                "drive of it can be compared."
            )
        num_vehicle_steps += vehicles.getIDCount()
        for edge, before in on_edge.items():
            now = set(libsumo.edge.getLastStepVehicleIDs(edge))
            passed[edge] += [simulation.getTime()] * len(before - now)
            on_edge[edge] = now
        if on_the_way and not has_left:
            on_the_way.difference_update(simulation.getArrivedIDList())
            has_left = not on_the_way and not to_come
            if has_left and not job.counted_edges:
                break
            num_frames += len(on_the_way) if step % steps_per_frame == 0 else 0
    arrived = inserted.copy()
    for waiting in simulation.getPendingVehicles():
        entrance = _entrance_of(waiting, job.entrance_of_flow)
        if entrance is not None:
            arrived[entrance] += 1
    return {
        "num_arrived": arrived,
        "num_inserted": inserted,
        "num_collisions": num_collisions,
        "num_subject_overlaps": num_overlaps,
        "num_teleports": num_teleports,
        "num_vehicle_steps": num_vehicle_steps,
        "subject_left": tuple(has_left or name not in to_come | on_the_way for name in job.subject_vehicles),
        "num_frames": num_frames,
        "passed_s": {edge: np.asarray(times) for edge, times in passed.items()},
    }


def _entrance_of(vehicle: str, entrance_of_flow: Mapping[str, int]) -> int | None:
    """Entrance of a vehicle, by its own id, by that of which it is a copy, or by its flow's."""
    for name in (vehicle, vehicle.partition(COPY)[0], vehicle.rpartition(".")[0]):
        if name in entrance_of_flow:
            return entrance_of_flow[name]
    return None


def _read_frames(output: Path, job: SumoJob) -> dict[str, np.ndarray]:
    number = {name: -1 - place for place, name in enumerate(job.subject_vehicles)}
    num_subjects = len(number)
    rows: list[tuple[float, ...]] = []
    with output.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file, delimiter=";")
        for line in reader:
            name = line.get("vehicle_id")  # SUMO leaves the column out if no vehicle was ever near
            if not name:
                continue
            place = job.lane_place.get(line["vehicle_lane"])
            if place is None or not place[2]:
                if name not in job.subject_vehicles:
                    continue
                raise TruncatedOutputError(f"the subject vehicle is on lane '{line['vehicle_lane']}', off its route")
            row, start_m, _ = place
            rows.append(
                (
                    float(line["timestep_time"]),
                    number.setdefault(name, len(number) - num_subjects),
                    row,
                    start_m + float(line["vehicle_pos"]),
                    float(line["vehicle_speed"]),
                    float(line["vehicle_acceleration"]),
                    float(line["vehicle_posLat"] or 0.0),
                )
            )
    table = np.asarray(rows, float).reshape(len(rows), 7)
    names = ("time_s", "vehicle", "row", "position_m", "speed_mps", "acceleration_mps2", "lateral_m")
    columns = dict(zip(names, table.T, strict=True))
    return columns | {name: columns[name].astype(int) for name in ("vehicle", "row")}
