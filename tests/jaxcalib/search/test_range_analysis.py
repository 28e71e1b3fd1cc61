import numpy as np
import pytest
from jaxtyping import Float
from scipy import stats

from jaxcalib.search import NO_LEVEL, RangeAnalysisConfig, analyse_ranges, orthogonal_array
from jaxcalib.search.range_analysis.case_means import average_replicates
from jaxcalib.search.range_analysis.noise import simulate_null_ranges

ARRAY = orthogonal_array(12, 4)
# An unsymmetric effect of each level of each parameter; the ranges differ and are not in the order of the parameters.
EFFECTS = np.array([0.013, 0.31, 0.0, 0.12, 0.02, 0.25, 0.07, 0.18, 0.001, 0.05, 0.4, 0.09])[:, None] * np.array(
    [0.3, 1.0, -0.2, 0.1]
)
EFFECTS[1::2] = EFFECTS[1::2, ::-1]


def additive_accuracy(effects: Float[np.ndarray, "parameter level"]) -> Float[np.ndarray, " case"]:
    return -0.37 + effects[np.arange(12), ARRAY.levels].sum(axis=1)


def test_a_planted_additive_effect_is_recovered_exactly() -> None:
    accuracy = additive_accuracy(EFFECTS)
    analysis = analyse_ranges(ARRAY, accuracy, num_critical=5)
    expected = accuracy.mean() + EFFECTS - EFFECTS.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(analysis.level_mean_accuracy, expected, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(analysis.accuracy_range, np.ptp(EFFECTS, axis=1), rtol=1e-12, atol=1e-14)
    assert (analysis.level_num_cases == 16).all()


def test_the_planted_ranking_and_the_best_levels_are_recovered() -> None:
    analysis = analyse_ranges(ARRAY, additive_accuracy(EFFECTS), num_critical=5)
    assert analysis.ranking.tolist() == [10, 1, 5, 7, 3, 11, 6, 9, 4, 0, 8, 2]
    assert analysis.critical_parameters.tolist() == [10, 1, 5, 7, 3]
    has_effect = np.arange(12) != 2
    assert (analysis.best_levels == np.argmax(EFFECTS, axis=1))[has_effect].all()
    assert not analysis.is_unreliable.any()
    assert not analysis.is_unbalanced


def test_equal_ranges_rank_by_index_and_equal_levels_go_to_the_lower_one() -> None:
    analysis = analyse_ranges(ARRAY, np.full(64, 0.25), num_critical=12)
    assert analysis.ranking.tolist() == list(range(12))
    assert (analysis.best_levels == 0).all()


def test_failed_cases_never_enter_a_level_mean() -> None:
    accuracy = additive_accuracy(EFFECTS)
    spoilt, is_ok = accuracy.copy(), np.ones(64, dtype=bool)
    spoilt[[3, 17]] = [np.nan, -np.inf]
    spoilt[40], is_ok[40] = 1e6, False
    analysis = analyse_ranges(ARRAY, spoilt, num_critical=3, is_ok=is_ok)
    is_counted = ~np.isin(np.arange(64), [3, 17, 40])
    for j in range(12):
        for level in range(4):
            cases = is_counted & (ARRAY.levels[:, j] == level)
            np.testing.assert_allclose(analysis.level_mean_accuracy[j, level], accuracy[cases].mean(), rtol=1e-12)
            assert analysis.level_num_cases[j, level] == cases.sum()
    assert analysis.is_unbalanced


def test_a_parameter_with_a_level_that_always_fails_is_flagged_and_ranked_last() -> None:
    accuracy = additive_accuracy(EFFECTS)
    accuracy[ARRAY.levels[:, 10] == 1] = np.nan  # the best level of the strongest parameter
    accuracy[np.flatnonzero(ARRAY.levels[:, 4] == 2)[1:]] = np.nan  # one case is left there, fewer than two
    analysis = analyse_ranges(ARRAY, accuracy, num_critical=4)
    assert analysis.is_unreliable.nonzero()[0].tolist() == [4, 10]
    assert analysis.ranking[-2:].tolist() == [4, 10]
    assert np.isnan(analysis.accuracy_range[[4, 10]]).all()
    assert np.isnan(analysis.level_mean_accuracy[[10, 4], [1, 2]]).all()
    assert analysis.best_levels[10] != 1
    assert 10 not in analysis.critical_parameters


def test_if_all_cases_fail_nothing_is_known() -> None:
    analysis = analyse_ranges(ARRAY, np.full((64, 3), np.nan), num_critical=4)
    assert (analysis.best_levels == NO_LEVEL).all()
    assert analysis.is_unreliable.all()
    assert analysis.noise is None
    assert analysis.analysis_of_variance is None


def test_pure_noise_is_called_indistinguishable_from_noise_in_95_percent_of_the_parameters() -> None:
    # N = 40 x 21 = 840 ranges without any effect, seed 11: binomial(840, 0.95), mean 798, s.d. 6.3, bound z = 4.
    # The 21 ranges of one data set share a variance estimate of 189 degrees of freedom, which adds 3 % to the s.d.
    rng = np.random.default_rng(11)
    array = orthogonal_array(21, 4)
    num_flagged = 0
    for _ in range(40):
        seed_effect = rng.normal(0.0, 0.5, size=(1, 4))  # common to all cases, cancels
        analysis = analyse_ranges(array, 0.3 + seed_effect + rng.normal(0.0, 0.2, size=(64, 4)), num_critical=10)
        assert analysis.noise is not None
        assert analysis.noise.source == "replicates"
        num_flagged += int(analysis.noise.is_indistinguishable.sum())
    assert abs(num_flagged - 798) < 4.0 * 6.3 * 1.03


def test_an_effect_well_above_the_noise_stands_out_and_one_well_below_does_not() -> None:
    rng = np.random.default_rng(5)
    accuracy = additive_accuracy(EFFECTS)[:, None] + rng.normal(0.0, 0.1, size=(64, 5))
    noise = analyse_ranges(ARRAY, accuracy, num_critical=5).noise
    assert noise is not None
    # The standard error of a level mean is 0.1 / sqrt(16 x 5) = 0.011, the 95 % quantile of the range about 0.041.
    np.testing.assert_allclose(noise.level_standard_error, 0.1 / np.sqrt(80), rtol=4 * np.sqrt(0.5 / 252))
    assert not noise.is_indistinguishable[[10, 1, 5, 7, 3]].any()
    assert noise.is_indistinguishable[[2, 8]].all()
    assert (noise.p_value[[10, 1, 5]] < 0.001).all()
    assert (noise.is_indistinguishable == (noise.p_value > 0.05)).all()


def test_the_source_of_the_error_variance_is_named() -> None:
    rng = np.random.default_rng(6)
    single = rng.normal(size=64)
    sources = []
    for array, accuracy, variance in (
        (ARRAY, single, 0.7),
        (ARRAY, np.stack([single, rng.normal(size=64)], axis=1), None),
        (ARRAY, single, None),
        (orthogonal_array(21, 4), single, None),
    ):
        noise = analyse_ranges(array, accuracy, num_critical=3, error_variance=variance).noise
        sources.append(None if noise is None else noise.source)
    assert sources == ["given", "replicates", "residual", None]


def test_a_given_variance_is_that_of_one_run() -> None:
    accuracy = np.random.default_rng(6).normal(size=(64, 4))
    accuracy[5, 2] = np.nan  # this case has three replicates
    noise = analyse_ranges(ARRAY, accuracy, num_critical=3, error_variance=0.7).noise
    assert noise is not None
    with_case_5 = ARRAY.levels[5, :, None] == np.arange(4)
    expected = np.where(with_case_5, np.sqrt(0.7 * (15 / 4 + 1 / 3)) / 16, np.sqrt(0.7 / 4 / 16))
    np.testing.assert_allclose(noise.level_standard_error, expected, rtol=1e-12)
    assert np.isinf(noise.degrees_of_freedom)


def test_simulated_ranges_follow_the_studentised_range() -> None:
    # 200000 draws; the 95 % quantile of the range of 4 has a standard error of at most 0.009 errors, bound 0.04.
    rng = np.random.default_rng(2)
    for degrees_of_freedom in (10.0, np.inf):
        draws = simulate_null_ranges(np.full(4, 0.3), degrees_of_freedom, 200000, rng)
        expected = 0.3 * stats.studentized_range.ppf(0.95, 4, degrees_of_freedom)
        assert abs(np.quantile(draws, 0.95) - expected) < 0.3 * 0.04


def test_aliases_are_the_pairs_on_a_line_with_the_factor() -> None:
    analysis = analyse_ranges(ARRAY, additive_accuracy(EFFECTS), num_critical=5)
    assert sum(len(pairs) for pairs in analysis.aliases) == 3 * 28
    for factor, pairs in enumerate(analysis.aliases):
        for j, k in pairs:
            assert j < k
            assert factor not in (j, k)
            # Planting that interaction shifts the level means of the factor; others on no line with it do not.
            product = (ARRAY.levels[:, j] == 1) * (ARRAY.levels[:, k] == 2) * 1.0
            assert analyse_ranges(ARRAY, product, num_critical=1).accuracy_range[factor] > 0.1
    j, k = 0, 4
    free = [f for f in range(12) if f not in (j, k) and (j, k) not in analysis.aliases[f]]
    product = (ARRAY.levels[:, j] == 1) * (ARRAY.levels[:, k] == 2) * 1.0
    np.testing.assert_allclose(analyse_ranges(ARRAY, product, num_critical=1).accuracy_range[free], 0.0, atol=1e-12)


def test_a_seed_that_fails_neither_favours_nor_harms_a_case() -> None:
    case_effect = np.array([0.2, -0.4, 0.7, 0.1, 0.35])
    seed_effect = np.array([0.0, 0.5, -0.3])
    accuracy = case_effect[:, None] + seed_effect
    accuracy[1, 1] = np.nan
    accuracy[3, 2] = np.nan
    accuracy[4, :2] = np.nan  # one of three seeds is left: too few
    means = average_replicates(accuracy)
    np.testing.assert_allclose(means.accuracy[:4], case_effect[:4] + seed_effect.mean(), rtol=1e-12)
    assert np.isnan(means.accuracy[4])
    assert means.num_replicates.tolist() == [3, 2, 3, 2, 0]
    assert means.replicate_degrees_of_freedom == 10 - (4 + 3 - 1)
    assert means.replicate_variance < 1e-25


def test_the_variance_of_a_replicate_is_the_two_way_residual() -> None:
    accuracy = np.random.default_rng(8).normal(size=(7, 4)) + np.arange(4.0)
    means = average_replicates(accuracy)
    residual = accuracy - accuracy.mean(axis=1, keepdims=True) - accuracy.mean(axis=0) + accuracy.mean()
    np.testing.assert_allclose(means.accuracy, accuracy.mean(axis=1), rtol=1e-12)
    np.testing.assert_allclose(means.replicate_variance, (residual**2).sum() / 18, rtol=1e-12)


def test_results_do_not_depend_on_global_random_state() -> None:
    accuracy = np.random.default_rng(3).normal(size=(64, 3))
    config = RangeAnalysisConfig(num_draws=500, seed=4)
    first, second = (analyse_ranges(ARRAY, accuracy, 4, config=config).noise for _ in range(2))
    assert first is not None
    assert second is not None
    assert (first.null_range_quantile == second.null_range_quantile).all()


def test_mistakes_of_the_caller_are_refused() -> None:
    with pytest.raises(ValueError, match=r"shape \(64,\) or \(64, seeds\) for L64\(4\^12\); got \(65,\)"):
        analyse_ranges(ARRAY, np.zeros(65), 3)
    with pytest.raises(ValueError, match="1 to 12 critical parameters; got 13"):
        analyse_ranges(ARRAY, np.zeros(64), 13)
