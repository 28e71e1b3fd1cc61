"""Holm's correction, by hand."""

import numpy as np
import pytest

from jaxcalib.statistics.multiple_tests import holm


@pytest.mark.parametrize(
    ("p_values", "adjusted"),
    [
        ([0.01, 0.04, np.nan, 0.03, 0.005], [0.03, 0.06, np.nan, 0.06, 0.02]),  # factors 3, 1, 2, 4, never falling
        ([0.03, np.nan, 0.01, 0.02], [0.04, np.nan, 0.03, 0.04]),  # 3 * 0.01, 2 * 0.02, 1 * 0.03 made monotonous
        ([0.7, 0.6], [1.0, 1.0]),
        ([np.nan], [np.nan]),
    ],
)
def test_factors_fall_with_the_rank_and_results_never_do(p_values: list[float], adjusted: list[float]) -> None:
    np.testing.assert_allclose(holm(np.asarray(p_values)), adjusted)
