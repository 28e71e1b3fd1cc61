"""Faults that are put into logs change what they say they do, and nothing else."""

import numpy as np
import pandas as pd
import pytest

from experiments.log_faults.faults import FAULTS
from tests.places import CORRIDOR


@pytest.fixture(scope="module")
def tables() -> tuple[pd.DataFrame, pd.DataFrame]:
    field = CORRIDOR / "field"
    return pd.read_csv(field / "d01_subject.csv.gz"), pd.read_csv(field / "d01_objects.csv.gz")


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_changes_one_of_the_tables_and_no_column_s_name(name: str, tables: tuple[pd.DataFrame, pd.DataFrame]):
    subject, objects = FAULTS[name].spoil(*tables)
    assert not (subject.equals(tables[0]) and objects.equals(tables[1]))
    assert list(subject.columns) == list(tables[0].columns)
    assert list(objects.columns) == list(tables[1].columns)


def test_sizes_are_those_that_are_said(tables: tuple[pd.DataFrame, pd.DataFrame]):
    subject, objects = tables
    spoilt, _ = FAULTS["aside"].spoil(subject, objects)
    north_m = 6_371_000.0 * (spoilt.latitude_rad - subject.latitude_rad)
    east_m = 6_371_000.0 * np.cos(subject.latitude_rad) * (spoilt.longitude_rad - subject.longitude_rad)
    assert np.hypot(north_m, east_m).to_numpy() == pytest.approx(12.0, abs=0.6)
    _, spoilt = FAULTS["small_doubles"].spoil(subject, objects)
    assert spoilt.vehicle_id.nunique() == pytest.approx(1.05 * objects.vehicle_id.nunique(), abs=1.0)
    _, spoilt = FAULTS["late_18"].spoil(subject, objects)
    assert spoilt.time_s.min() == pytest.approx(objects.time_s.min() + 18.0)
