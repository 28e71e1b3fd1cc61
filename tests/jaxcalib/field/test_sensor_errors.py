"""What sensors got wrong is measured from tracks alone, and taken off; what vehicles do themselves is left alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jaxcalib.field.log_tables import ObjectLog
from jaxcalib.field.physics.motion import DriveMotion
from jaxcalib.field.sensor_errors import HONEST, SensorErrors, measure_sensors, smoothed, without_errors
from tests.jaxcalib.field.physics import motions
from tests.jaxcalib.field.physics.motions import drive, judged, thinned

NUM_DRIVES = 4


@pytest.fixture
def honest(monkeypatch: pytest.MonkeyPatch) -> list[DriveMotion]:
    """Drives without noise; tracks of one seed are the same with noise and without it."""
    for name in ("PLACE_NOISE_M", "DISTANCE_NOISE_M", "SPEED_NOISE_MPS"):
        monkeypatch.setattr(motions, name, 0.0)
    return [drive(seed) for seed in range(NUM_DRIVES)]


def log_of(motion: DriveMotion) -> ObjectLog:
    """The objects' table of a drive."""
    unknown, nothing = np.zeros(len(motion.vehicle), int), np.full(len(motion.vehicle), np.nan)
    ids = tuple(str(number) for number in range(motion.vehicle.max() + 1))
    return ObjectLog(
        Path("o.csv"), motion.object_time_s, motion.vehicle, ids, unknown, motion.relative_x_m, motion.relative_y_m,
        motion.object_speed_mps, nothing, nothing, None, (),
    )  # fmt: skip


def later(motion: DriveMotion, steps: int) -> DriveMotion:
    """The drive with its objects reported some steps late."""
    time_s = motion.object_time_s + steps * motion.sampling_s
    return replace(motion, object_time_s=time_s).without(time_s > motion.time_s[-1] + 1e-6)


def test_honest_sensors_are_left_alone(honest: list[DriveMotion]):
    assert measure_sensors(honest) == HONEST
    assert HONEST.warnings() == []
    assert measure_sensors([]) == HONEST


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (lambda m: replace(m, relative_x_m=1.07 * m.relative_x_m), SensorErrors(distance_factor=1.07)),
        (lambda m: replace(m, relative_x_m=0.88 * m.relative_x_m), SensorErrors(distance_factor=0.88)),
        (lambda m: later(m, 4), SensorErrors(late_s=0.4)),
        (lambda m: later(replace(m, relative_x_m=0.9 * m.relative_x_m), 7), SensorErrors(0.9, 0.7)),
    ],
)
def test_factors_and_delays_are_measured_and_taken_off(honest: list[DriveMotion], spoil, expected: SensorErrors):
    errors = measure_sensors([spoil(motion) for motion in honest])
    assert errors.distance_factor == pytest.approx(expected.distance_factor, abs=0.005)
    assert errors.late_s == pytest.approx(expected.late_s, abs=0.03)
    assert (errors.distance_noise_m, errors.speed_noise_mps) == (0.0, 0.0)
    spoilt = spoil(honest[0])
    cured = without_errors(log_of(spoilt), spoilt, expected)
    true = {
        (vehicle, round(at_s, 3)): x_m
        for vehicle, at_s, x_m in zip(honest[0].vehicle, honest[0].object_time_s, honest[0].relative_x_m, strict=True)
    }
    keys = [(vehicle, round(at_s, 3)) for vehicle, at_s in zip(cured.vehicle, cured.time_s, strict=True)]
    assert len(keys) > 0.9 * len(true)
    assert cured.relative_x_m == pytest.approx(np.asarray([true[key] for key in keys]), abs=1e-6)
    assert len(errors.warnings()) == (expected.distance_factor != 1.0) + (expected.late_s > 0.0)


def test_late_speeds_of_the_subject_vehicle_are_no_delay_of_its_objects(honest: list[DriveMotion]):
    early = [replace(m, speed_mps=np.interp(m.time_s + 0.5, m.time_s, m.speed_mps)) for m in honest]
    assert measure_sensors(early).late_s == pytest.approx(0.5, abs=0.1)  # against these speeds
    found = judged(early)
    assert [one.kind for one in found] == ["speed_delay"]
    assert measure_sensors(early, found).late_s == 0.0


def test_noise_is_measured_and_most_of_it_is_taken_off(honest: list[DriveMotion], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(motions, "DISTANCE_NOISE_M", 0.7)
    monkeypatch.setattr(motions, "SPEED_NOISE_MPS", 0.4)
    noisy = [replace(m, speed_mps=h.speed_mps) for m, h in zip(map(drive, range(NUM_DRIVES)), honest, strict=True)]
    errors = measure_sensors(noisy)
    assert errors.distance_noise_m == pytest.approx(0.7, rel=0.03)
    assert errors.speed_noise_mps == pytest.approx(0.4, rel=0.03)
    assert (errors.distance_factor, errors.late_s) == (1.0, 0.0)
    rows = np.isin(noisy[0].vehicle * 1e6 + noisy[0].object_time_s, honest[0].vehicle * 1e6 + honest[0].object_time_s)
    cured = without_errors(log_of(noisy[0]), noisy[0], errors)
    others = np.isin(honest[0].vehicle * 1e6 + honest[0].object_time_s, noisy[0].vehicle * 1e6 + noisy[0].object_time_s)
    assert np.std(cured.relative_x_m[rows] - honest[0].relative_x_m[others]) < 0.3 * 0.7
    assert np.std(cured.speed_mps[rows] - honest[0].object_speed_mps[others]) < 0.4 * 0.4


@pytest.mark.parametrize("step_s", [0.1, 0.5, 1.0])
def test_drivers_who_dawdle_are_no_noise_of_sensors(honest: list[DriveMotion], step_s: float):
    """Speeds change at random at every step, and distances go with them, as in SUMO's step by the new speed."""
    random, every = np.random.default_rng(7), round(step_s / motions.SAMPLING_S)
    spoilt = []
    for motion in honest:
        coarse = thinned(motion, every)
        speed_mps = np.maximum(coarse.object_speed_mps - 0.6 * random.uniform(0.0, 1.0, len(coarse.vehicle)), 0.0)
        own_mps = np.interp(coarse.object_time_s, coarse.time_s, coarse.speed_mps)
        relative_x_m = coarse.relative_x_m.copy()
        for number in np.unique(coarse.vehicle):
            mine = np.flatnonzero(coarse.vehicle == number)
            step_m = step_s * (speed_mps[mine] - own_mps[mine])
            relative_x_m[mine] = relative_x_m[mine][0] + np.concatenate([[0.0], np.cumsum(step_m[1:])])
        spoilt.append(replace(coarse, relative_x_m=relative_x_m, object_speed_mps=speed_mps))
    errors = measure_sensors(spoilt)
    assert (errors.distance_noise_m, errors.speed_noise_mps) == (0.0, 0.0)


def test_a_smoother_leaves_what_it_holds_small_differences_of_and_keeps_runs_apart():
    steps = np.arange(40.0)
    parabolas = np.concatenate([3.0 + 2.0 * steps - 0.1 * steps**2, 100.0 - steps, [7.0, 9.0]])
    run = np.repeat([0, 1, 2], [40, 40, 2])
    assert smoothed(parabolas, run, 3, 1e4) == pytest.approx(parabolas, abs=1e-6)
    spoilt = parabolas.copy()
    spoilt[10] += 5.0
    assert smoothed(spoilt, run, 3, 1e4)[40:] == pytest.approx(parabolas[40:], abs=1e-6)
    assert abs(smoothed(spoilt, run, 3, 1e4)[10] - parabolas[10]) < 1.0
    assert smoothed(spoilt, run, 2, 0.0) == pytest.approx(spoilt)
    assert len(smoothed(np.zeros(0), np.zeros(0, int), 2, 1.0)) == 0
