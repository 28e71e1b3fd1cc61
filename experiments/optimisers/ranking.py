"""Which optimisers differ beyond chance: medians with intervals, mean ranks, Friedman's and Wilcoxon's tests."""

from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import friedmanchisquare, rankdata, wilcoxon

from jaxcalib.statistics.bootstrap import percentile_interval
from jaxcalib.statistics.multiple_tests import holm

NUM_DRAWS = 2_000
FEWEST_BLOCKS = 3


def summary_table(rows: pd.DataFrame, seed: int = 0) -> pd.DataFrame:
    """Return median error with its 95 % interval for each problem, budget, checkpoint and optimiser.

    The interval is the bootstrap's, over seeds; rows are those of `run_course`.
    """
    random = np.random.default_rng(seed)
    keys = ["problem", "budget", "share", "optimiser"]
    summaries = []
    key: Any
    group: Any
    for key, group in rows.groupby(keys, sort=False):
        errors = group["error"].to_numpy(float)
        errors = np.where(np.isfinite(errors), errors, np.inf)  # a search without a result is the worst
        interval = percentile_interval(
            lambda drawn, errors=errors: float(np.median(errors[drawn])), len(errors), random, NUM_DRAWS,
            method="nearest",
        )  # fmt: skip
        assert interval is not None
        times = {name: float(group[name].median()) for name in ("num_evaluated", "optimiser_s", "evaluation_s")}
        summaries.append(
            dict(zip(keys, key, strict=True))
            | {"median": float(np.median(errors)), "low": interval[0], "high": interval[1], "num_seeds": len(errors)}
            | times
        )
    return pd.DataFrame(summaries)


def rank_table(blocks: pd.DataFrame) -> pd.DataFrame:
    """Return mean ranks, and how surely each optimiser is worse than the one of the best mean rank.

    Args:
        blocks: errors, [block, optimiser]: seeds of one problem, or problems.

    Returns:
        One row per optimiser, best first: `mean_rank`, and `p_value` of Wilcoxon's signed-rank test against the first,
        two-sided, corrected by Holm's method over the optimisers; nan for the first and for fewer than three blocks.
        `friedman_p` is the same in all rows: whether any two differ.

    Source: Demsar (2006), Statistical comparisons of classifiers over multiple data sets, JMLR 7; Holm (1979), A simple
        sequentially rejective multiple test procedure, Scand. J. Stat. 6.
    """
    errors = blocks.to_numpy(float)
    errors = np.where(np.isfinite(errors), errors, np.inf)
    num_blocks, num_optimisers = errors.shape
    ranks = rankdata(errors, axis=1).mean(axis=0)
    order = np.argsort(ranks, kind="stable")
    friedman = np.nan
    if num_blocks >= FEWEST_BLOCKS and num_optimisers >= FEWEST_BLOCKS:
        friedman = float(friedmanchisquare(*rankdata(errors, axis=1).T).pvalue)
    best = errors[:, order[0]]
    raw = np.full(num_optimisers, np.nan)
    for optimiser in order[1:]:
        if num_blocks >= FEWEST_BLOCKS:
            raw[optimiser] = _signed_rank(errors[:, optimiser], best)
    adjusted = holm(raw)
    return pd.DataFrame(
        {
            "optimiser": [str(blocks.columns[optimiser]) for optimiser in order],
            "mean_rank": ranks[order],
            "p_value": adjusted[order],
            "friedman_p": friedman,
            "num_blocks": num_blocks,
        }
    )


def all_rank_tables(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the ranks at the end of the budget: for each problem over seeds, and for all over problems."""
    last: Any = rows[rows["share"] == rows["share"].max()]
    tables = []
    for budget, of_budget in last.groupby("budget", sort=False):
        for problem, group in of_budget.groupby("problem", sort=False):
            table = rank_table(group.pivot_table(index="seed", columns="optimiser", values="error", dropna=False))
            tables.append(table.assign(budget=budget, problem=problem))
        if of_budget["problem"].nunique() > 1:
            failed_last = of_budget.assign(error=of_budget["error"].fillna(np.inf))
            medians = failed_last.pivot_table(index="problem", columns="optimiser", values="error", aggfunc="median")
            tables.append(rank_table(medians).assign(budget=budget, problem="all"))
    return pd.concat(tables, ignore_index=True)


def _signed_rank(errors: np.ndarray, best: np.ndarray) -> float:
    with np.errstate(invalid="ignore"):
        difference = np.where(errors == best, 0.0, errors - best)
    if not difference.any():
        return 1.0
    result: Any = wilcoxon(np.clip(difference, -1e12, 1e12), zero_method="zsplit")
    return float(result.pvalue)
