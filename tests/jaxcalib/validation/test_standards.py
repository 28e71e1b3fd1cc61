"""GEH and the criteria of FHWA against numbers worked out by hand."""

import numpy as np
import pytest

from jaxcalib.validation.criterion import at_least, at_most
from jaxcalib.validation.fhwa_2019 import criteria_2019, day_envelope
from jaxcalib.validation.volumes import Volume, bound_2004_vehph, geh, sum_of_volumes, volume_criteria


@pytest.mark.parametrize(
    ("simulated", "field", "expected"),
    [(1200.0, 1000.0, np.sqrt(2 * 200.0**2 / 2200.0)), (81.0, 144.0, np.sqrt(2 * 63.0**2 / 225.0)), (0.0, 0.0, 0.0)],
)
def test_geh(simulated: float, field: float, expected: float):
    assert float(geh(np.asarray(simulated), np.asarray(field))) == pytest.approx(expected)


def test_geh_of_quarters_of_an_hour_is_half_of_that_of_hours():
    """It grows with the square root of the period, which is why counts become hourly rates first."""
    hourly, quarter = (geh(np.asarray(a), np.asarray(b)) for a, b in ((1300.0, 1100.0), (325.0, 275.0)))
    assert float(quarter) == pytest.approx(0.5 * float(hourly))


@pytest.mark.parametrize(("field", "bound"), [(500.0, 100.0), (1000.0, 150.0), (2700.0, 405.0), (4000.0, 400.0)])
def test_bounds_of_2004(field: float, bound: float):
    assert bound_2004_vehph(field) == pytest.approx(bound)
    assert Volume("x", field, field + bound).is_within_2004
    assert not Volume("x", field, field + 1.01 * bound).is_within_2004


def test_volume_criteria():
    volumes = [Volume("a", 1000.0, 1050.0), Volume("b", 600.0, 690.0), Volume("c", 3000.0, 2500.0)]
    shares = volume_criteria(volumes, "hand")
    assert [one.passes for one in shares] == [False, False, False, False]
    assert shares[0].value == pytest.approx(2 / 3, abs=1e-5)  # GEH 1.6, 3.5, 9.5
    assert shares[1].value == pytest.approx(2 / 3, abs=1e-5)
    assert shares[2].value == pytest.approx(360.0 / 4600.0, abs=1e-5)
    good = volume_criteria([Volume("a", 1000.0, 1010.0), Volume("b", 600.0, 590.0)], "hand")
    assert all(one.passes for one in good)


DAYS = np.asarray([[100.0, 200.0, 300.0], [110.0, 190.0, 310.0], [120.0, 230.0, 330.0]])


def test_the_envelope_of_days():
    envelope = day_envelope(DAYS)
    assert envelope.representative == 1  # the mean is 110, 206.7, 313.3
    np.testing.assert_allclose(envelope.sigma, [10.0, 20.8167, 15.2753], rtol=1e-5)
    assert envelope.bdae_threshold == pytest.approx(np.mean([10, 10, 10, 10, 40, 20]))


def test_criteria_of_2019():
    passed = criteria_2019(DAYS, np.asarray([112.0, 185.0, 306.0]), "x")
    assert [one.passes for one in passed] == [True, True, True, True]
    assert passed[2].value == pytest.approx((2 + 5 + 4) / 3, abs=1e-5)
    assert passed[3].value == pytest.approx(7 / 3, abs=1e-5)
    assert passed[3].limit == pytest.approx(100 / 6 / 3, abs=1e-5)
    shifted = criteria_2019(DAYS, DAYS[1] + np.asarray([9.0, 15.0, 15.0]), "x")
    assert [one.passes for one in shifted] == [True, True, True, False]  # within the envelope, but always above
    wild = criteria_2019(DAYS, DAYS[1] + np.asarray([90.0, -90.0, 0.0]), "x")
    assert [one.passes for one in wild] == [False, False, False, True]


def test_what_is_not_known_is_neither_passed_nor_failed():
    assert at_most("x", "y", float("nan"), 1.0).passes is None
    assert at_least("x", "y", 1.0, float("nan")).passes is None
    assert at_most("x", "y", 1.0, 1.0).passes is True
    assert at_least("x", "y", 0.9, 1.0).passes is False


def test_intervals_of_one_edge_are_one_hourly_rate_in_the_sum():
    quarters = [Volume(f"a {number}", 4000.0, 3840.0, "a", 900.0) for number in range(4)]
    (hour,) = [Volume("a", 4000.0, 3840.0, "a", 3600.0)]
    assert sum_of_volumes(quarters) == sum_of_volumes([hour]) == (3840.0, 4000.0)
    of_sum = [[one for one in volume_criteria(some, "hand") if "sum" in one.name] for some in (quarters, [hour])]
    assert [one.value for one in of_sum[0]] == [one.value for one in of_sum[1]]
    uneven = [Volume("a 1", 1000.0, 900.0, "a", 600.0), Volume("a 2", 400.0, 700.0, "a", 1800.0)]
    other = Volume("b", 300.0, 310.0, "b", 600.0)
    assert sum_of_volumes([*uneven, other]) == pytest.approx((750.0 + 310.0, 550.0 + 300.0))
