"""Does an injection change anything? Runs with and without it, of the same seeds, side by side."""

from collections.abc import Sequence
from typing import TypedDict

import numpy as np
from scipy.stats import false_discovery_control, ttest_ind

Measures = dict[str, float]


class ManipulationCheck(TypedDict):
    """What an injection changed."""

    # share of the drives whose log differs from that of the same seed without the effect; SUMO repeats a run of
    # the same seed exactly, so nothing but the injection makes a difference
    drives_changed: float
    most_changed: str  # the plain statistic that changed most, beyond what seeds do
    standard_deviations: float  # by how many standard deviations among seeds it changed
    p_adjusted: float  # probability of such a change among all statistics by chance (Benjamini-Hochberg)
    beyond_seeds: bool  # whether that probability is below 0.05


def manipulation_check(
    with_effect: Sequence[Measures], without: Sequence[Measures], changed: Sequence[bool]
) -> ManipulationCheck:
    """Compare plain statistics of drives with an effect with those of the same drives, same seeds, without it.

    `changed` says whether the logs of a drive differ.
    """
    names = sorted(without[0])
    ours = np.array([[measures[name] for name in names] for measures in with_effect])
    theirs = np.array([[measures[name] for name in names] for measures in without])
    spread = np.sqrt(0.5 * (ours.var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)))
    usable = np.isfinite(spread) & (spread > 0.0)
    p = np.ones(len(names))
    p[usable] = np.asarray(ttest_ind(ours[:, usable], theirs[:, usable], equal_var=False)[1])
    adjusted = false_discovery_control(np.nan_to_num(p, nan=1.0))
    best = int(np.argmin(adjusted + 1e-6 * p))
    shift = float((ours[:, best] - theirs[:, best]).mean() / spread[best]) if usable[best] else 0.0
    return ManipulationCheck(
        drives_changed=float(np.mean(changed)),
        most_changed=names[best],
        standard_deviations=round(shift, 2),
        p_adjusted=float(f"{adjusted[best]:.3g}"),
        beyond_seeds=bool(adjusted[best] < 0.05),
    )
