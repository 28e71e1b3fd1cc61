"""How well rules of gap acceptance tell the gaps that drivers took from those they let pass.

Scores that mean something here: three of four gaps were taken, so always-accept has a high accuracy without knowing
anything; its balanced accuracy (mean of the shares right among those taken and among those let pass) is 1/2, and so is
the area under its ROC. A rule is better than always-accept if its area exceeds 1/2 beyond the bootstrap interval.
Whatever is fitted - the strictness with the best balanced accuracy, and the logistic function of a rule's margin that
gives it a probability and so a log loss - is fitted on the one site and judged on the other.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import log_loss, roc_curve
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from experiments.fidelity.gap_rules import GapRule, gap_rules
from experiments.fidelity.recorded_decisions import RecordedDecisions, read_decisions
from jaxcalib.statistics.bootstrap import percentile_interval

NUM_RESAMPLES = 1000
ALWAYS = "always accept"
REFERENCE = "logistic regression"
NOBODY_M = 100.0  # for the regression, who is no nearer plays no part

Flags = Bool[np.ndarray, " decision"]
Number = Float[np.ndarray, " decision"]
Features = Float[np.ndarray, "decision feature"]


def lane_change_table(data: Path) -> list[dict[str, Any]]:
    """Return the scores of each rule on NGSIM's decisions, with those of always-accept and of a regression.

    The regression knows gaps, speeds and speed differences: what a smooth rule could make of these data.
    """
    decisions = read_decisions(data)
    features = _features(decisions)
    probability = _probability(decisions, features)
    nothing = np.zeros((len(features), 1))
    return [
        scores(ALWAYS, decisions, nothing[:, 0], nothing[:, 0] == 0.0, _probability(decisions, nothing)),
        *(_scores_of(rule, decisions) for rule in gap_rules()),
        scores(REFERENCE, decisions, probability, probability > 0.5, probability),
    ]


def scores(name: str, decisions: RecordedDecisions, margin: Number, goes: Flags, probability: Number) -> dict[str, Any]:
    """Return the scores of one rule, from how good it finds each gap, in any unit, and whether it goes as stated.

    The probability with which drivers go, by the rule, is fitted on the other site.
    """
    taken = decisions.is_accepted
    false_rate, true_rate, _ = roc_curve(taken, margin)
    return {
        "rule": name,
        "num_decisions": len(taken),
        "true_rate": float(goes[taken].mean()),
        "false_rate": float(goes[~taken].mean()),
        "accuracy": float(np.mean(goes == taken)),
        "balanced_accuracy": balanced_accuracy(taken, goes),
        "balanced_accuracy_interval": _interval(balanced_accuracy, taken, goes),
        "roc_area": roc_area(taken, margin),
        "roc_area_interval": _interval(roc_area, taken, margin),
        "roc_area_by_site": {
            str(site): roc_area(taken[decisions.site == site], margin[decisions.site == site])
            for site in np.unique(decisions.site)
        },
        "log_loss": float(log_loss(taken, probability)),
        "roc": {"false_rate": false_rate.round(4).tolist(), "true_rate": true_rate.round(4).tolist()},
    }


def roc_area(taken: Flags, margin: Number) -> float:
    """Return the probability that a gap taken has the larger margin than one let pass; ties count half."""
    values, index = np.unique(margin, return_inverse=True)
    num_taken = np.bincount(index[taken], minlength=len(values))
    num_passed = np.bincount(index[~taken], minlength=len(values))
    num_below = np.cumsum(num_passed) - 0.5 * num_passed
    return float(np.sum(num_taken * num_below) / (num_taken.sum() * num_passed.sum()))


def balanced_accuracy(taken: Flags, goes: Flags) -> float:
    """Return the mean of the shares right among the gaps taken and among those let pass."""
    return float(0.5 * (np.mean(goes[taken]) + np.mean(~goes[~taken])))


def _scores_of(rule: GapRule, decisions: RecordedDecisions) -> dict[str, Any]:
    goes = rule.at_all_levels(decisions)
    margin = goes.sum(axis=0).astype(float)
    # where even the least strict rule says no, the margin says nothing more
    features = np.stack([margin, margin == 0.0], axis=1)
    stated = scores(rule.name, decisions, margin, rule.stated(decisions), _probability(decisions, features))
    fitted = np.zeros(len(margin), bool)
    levels: dict[str, float] = {}
    for site, here, elsewhere in _sites(decisions):
        by_level = [balanced_accuracy(decisions.is_accepted[elsewhere], at_level[elsewhere]) for at_level in goes]
        best = int(np.argmax(by_level))
        fitted[here], levels[site] = goes[best, here], float(rule.levels[best])
    taken = decisions.is_accepted
    return stated | {
        "parameter": rule.parameter,
        "stated_value": float(rule.place(rule.drivers)),
        "fitted_on_other_site": levels,
        "fitted_accuracy": float(np.mean(fitted == taken)),
        "fitted_balanced_accuracy": balanced_accuracy(taken, fitted),
        "fitted_balanced_accuracy_interval": _interval(balanced_accuracy, taken, fitted),
    }


def _sites(decisions: RecordedDecisions) -> list[tuple[str, Flags, Flags]]:
    return [(str(site), decisions.site == site, decisions.site != site) for site in np.unique(decisions.site)]


def _probability(decisions: RecordedDecisions, features: Features) -> Number:
    """Return the probability of going by a logistic regression on the other site."""
    probability = np.zeros(len(features))
    for _, here, elsewhere in _sites(decisions):
        fit = make_pipeline(StandardScaler(), LogisticRegression())
        fit.fit(features[elsewhere], decisions.is_accepted[elsewhere])
        probability[here] = fit.predict_proba(features[here])[:, 1]
    return probability


def _features(decisions: RecordedDecisions) -> Features:
    def near(distance_m: Number) -> Number:
        return np.clip(np.nan_to_num(distance_m, nan=NOBODY_M), -NOBODY_M, NOBODY_M)

    speed = decisions.speed_mps
    leader_mps = np.where(np.isnan(decisions.leader_m), speed, decisions.leader_mps)
    return np.stack(
        [
            near(decisions.follower_m), near(decisions.leader_m), speed - decisions.follower_mps, leader_mps - speed,
            speed,
        ],
        axis=1,
    )  # fmt: skip


def _interval(score: Callable[[Flags, Any], float], taken: Flags, answer: np.ndarray) -> tuple[float, float]:
    """Return the bootstrap interval over decisions."""
    interval = percentile_interval(
        lambda drawn: score(taken[drawn], answer[drawn]), len(taken), np.random.default_rng(1), NUM_RESAMPLES
    )
    assert interval is not None
    return interval
