import numpy as np
from scipy import stats

from jaxcalib.search import analyse_ranges, orthogonal_array
from jaxcalib.search.range_analysis.analysis_of_variance import analyse_variance


def test_one_factor_agrees_with_scipy() -> None:
    levels = orthogonal_array(1, 5).levels
    accuracy = 0.3 * levels[:, 0] ** 2 + np.random.default_rng(1).normal(size=25)
    result = analyse_variance(levels, accuracy)
    groups = [accuracy[levels[:, 0] == level] for level in range(5)]
    expected = stats.f_oneway(*groups)
    assert result is not None
    np.testing.assert_allclose(result.f_statistic[0], expected.statistic, rtol=1e-10)
    np.testing.assert_allclose(result.p_value[0], expected.pvalue, rtol=1e-10)


def test_one_factor_with_failed_cases_agrees_with_scipy_on_the_others() -> None:
    levels = orthogonal_array(1, 5).levels
    accuracy = 0.3 * levels[:, 0] + np.random.default_rng(2).normal(size=25)
    accuracy[[0, 7, 8, 21]] = np.nan
    result = analyse_variance(levels, accuracy)
    groups = [accuracy[(levels[:, 0] == level) & np.isfinite(accuracy)] for level in range(5)]
    expected = stats.f_oneway(*groups)
    assert result is not None
    assert result.error_degrees_of_freedom == 25 - 4 - 5
    np.testing.assert_allclose(result.p_value[0], expected.pvalue, rtol=1e-10)


def test_the_sums_of_squares_of_a_complete_array_are_the_classical_ones() -> None:
    array = orthogonal_array(12, 4)
    accuracy = np.random.default_rng(3).normal(size=64) - 0.7
    result = analyse_ranges(array, accuracy, num_critical=3)
    variance = result.analysis_of_variance
    assert variance is not None
    classical = (16 * (result.level_mean_accuracy - accuracy.mean()) ** 2).sum(axis=1)
    np.testing.assert_allclose(variance.sum_of_squares, classical, rtol=1e-10)
    assert (variance.degrees_of_freedom == 3).all()
    assert variance.error_degrees_of_freedom == array.error_degrees_of_freedom == 27
    total = ((accuracy - accuracy.mean()) ** 2).sum()
    np.testing.assert_allclose(classical.sum() + 27 * variance.error_mean_square, total, rtol=1e-10)
    expected = stats.f.sf(classical / 3 / variance.error_mean_square, 3, 27)
    np.testing.assert_allclose(variance.p_value, expected, rtol=1e-9)


def test_without_error_degrees_of_freedom_there_is_no_analysis() -> None:
    assert analyse_variance(orthogonal_array(21, 4).levels, np.arange(64.0)) is None
    assert analyse_variance(orthogonal_array(1, 2).levels, np.array([1.0, np.nan, np.nan, np.nan])) is None


def test_p_values_without_effects_are_uniform() -> None:
    # 30 x 12 p values, seed 4; the Kolmogorov-Smirnov test at 0.1 %. Values of one data set share the error estimate.
    rng = np.random.default_rng(4)
    levels = orthogonal_array(12, 4).levels
    results = [analyse_variance(levels, rng.normal(size=64)) for _ in range(30)]
    p_values = np.concatenate([result.p_value for result in results if result is not None])
    assert stats.kstest(p_values, "uniform").pvalue > 0.001


def test_an_interaction_shows_as_lack_of_fit_and_additive_effects_do_not() -> None:
    rng = np.random.default_rng(9)
    array = orthogonal_array(5, 4, least_cases=64)
    noise = rng.normal(0.0, 0.05, size=(64, 4))
    additive = 0.2 * array.levels[:, 0] - 0.1 * array.levels[:, 3]
    product = 0.1 * (array.levels[:, 0] == 2) * (array.levels[:, 1] == 1)
    p_values = []
    for accuracy in (additive, additive + 3.0 * product):
        variance = analyse_ranges(array, accuracy[:, None] + noise, num_critical=2).analysis_of_variance
        assert variance is not None
        p_values.append(variance.lack_of_fit_p_value)
    assert p_values[0] > 0.01
    assert p_values[1] < 1e-6


def test_lack_of_fit_against_a_known_variance_is_a_chi_square_test() -> None:
    levels = orthogonal_array(2, 3).levels
    accuracy = np.random.default_rng(10).normal(size=9)
    result = analyse_variance(levels, accuracy, noise_variance=1.3, noise_degrees_of_freedom=np.inf)
    assert result is not None
    expected = stats.chi2.sf(4 * result.error_mean_square / 1.3, 4)
    np.testing.assert_allclose(result.lack_of_fit_p_value, expected, rtol=1e-12)
    assert np.isnan(getattr(analyse_variance(levels, accuracy), "lack_of_fit_p_value", 0.0))
