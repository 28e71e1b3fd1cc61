"""What each fault does to a log, on a log made by hand."""

import numpy as np
import pandas as pd
import pytest

from experiments.blind_effects import sensors
from experiments.blind_effects.field_spec import SensorFault
from experiments.roads.road import ROADS

TIMES = np.round(300.0 + np.arange(200) / 10.0, 1)


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch):
    subject = pd.DataFrame({"time_s": TIMES, "longitude_rad": 0.2, "latitude_rad": 0.8})
    rows = [
        {"time_s": time, "vehicle_id": name, "lane": 1, "relative_x_m": x + 0.5 * (time - 300.0), "speed_kmh": 60.0}
        for time in TIMES
        for name, x in (("late", -40.0), ("front", 20.0), ("far", 139.0))
    ]
    objects = pd.DataFrame(rows)
    monkeypatch.setattr(sensors, "subject_table", lambda recording, road: subject)
    monkeypatch.setattr(sensors, "objects_table", lambda recording, road, reach_m: objects)
    return lambda **fault: sensors.logs(None, ROADS["corridor"], SensorFault(**fault), 3)  # type: ignore[arg-type]


def test_a_perfect_sensor_numbers_by_first_sight(made):
    _, objects = made()
    assert list(objects.vehicle_id[:3]) == [1, 2, 3]
    assert len(objects) == 600


def test_bias_and_range(made):
    assert made(bias=-0.1)[1].relative_x_m[1] == pytest.approx(18.0)
    near = made(range_loss=0.5)[1]
    assert near.relative_x_m.abs().max() <= 75.0
    assert 0.9 < len(near) / 400 < 0.99  # a twentieth is lost


def test_latency_shows_the_past(made):
    table = made(latency_s=0.4)[1]
    front = table[table.vehicle_id == 2].set_index("time_s")
    assert front.index.min() == pytest.approx(300.4)
    assert front.relative_x_m[305.0] == pytest.approx(20.0 + 0.5 * 4.6)
    assert front.index.max() == TIMES[-1]


def test_noise_has_its_standard_deviation(made):
    noisy, clean = made(noise=0.5)[1], made()[1]
    error = noisy.relative_x_m[noisy.vehicle_id == 2].to_numpy() - clean.relative_x_m[clean.vehicle_id == 2].to_numpy()
    assert np.std(error) == pytest.approx(0.5, rel=0.15)  # three standard errors of 200 samples
    assert np.std(noisy.speed_kmh) == pytest.approx(1.8, rel=0.15)


def test_swaps_keep_every_row(made):
    swapped, clean = made(swaps_per_min=30.0)[1], made()[1]
    assert (swapped.vehicle_id != clean.vehicle_id).any()
    assert not swapped.duplicated(["time_s", "vehicle_id"]).any()


def test_map_offset_is_in_metres_to_the_east(made):
    subject, _ = made(map_offset_m=50.0)
    assert (subject.longitude_rad[0] - 0.2) * 6_371_000.0 * np.cos(0.8) == pytest.approx(50.0, abs=0.01)


def test_clock_drift_keeps_one_row_per_vehicle_and_time(made):
    _, objects = made(clock_drift=0.02)
    assert not objects.duplicated(["time_s", "vehicle_id"]).any()
    assert objects.time_s.max() <= TIMES[-1]
