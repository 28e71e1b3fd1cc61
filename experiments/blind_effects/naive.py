"""What anybody would try first: three baselines that a diagnosis has to beat on the same cases."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from sklearn.ensemble import RandomForestClassifier
from sklearn.impute import SimpleImputer
from sklearn.model_selection import KFold
from sklearn.pipeline import make_pipeline

from experiments.blind_effects.answers import Answered
from experiments.blind_effects.raw_measures import raw_measures, read_table

MOST_FOLDS = 20
GAINS = ("training_gain", "held_out_gain")
# The first words that a measure's name holds decide; what an engineer would blame at once.
BLAMED = (
    ("cut_in", "lane_change_relaxation"),
    ("lane_change_distance", "cooperative_yielding"),
    ("lane_change", "lane_change_duration"),
    ("lane_share", "keep_right"),
    ("lane", "keep_right"),
    ("gap_rate", "gap_sensor_bias"),
    ("subject", "subject_actuation_lag"),
    ("acceleration", "reaction_delay"),
    ("headway", "memory"),
    ("gap", "memory"),
    ("density", "ramp_inflow_error"),
    ("volume", "ramp_inflow_error"),
    ("flow", "ramp_inflow_error"),
    ("speed", "local_speed_reduction"),
    ("dynamics", "acceleration_noise"),
    ("track", "sensor_range"),
)


def largest_gain(case: Answered) -> str | None:
    """Return the effect with which the error falls most, no matter what chance would do.

    The gain in training where the answer states it, else that on held-out drives; None where it states neither.
    """
    for key in GAINS:
        entries = [
            entry
            for entry in case.answer["ranking"]
            if entry.get(key) is not None and entry["effect"] not in ("none", "unknown")
        ]
        if entries:
            return str(max(entries, key=lambda entry: entry[key])["effect"])
    return None


def largest_error(case: Answered) -> str | None:
    """Return the effect that is usually blamed for the measure with the largest gap; None where nothing is."""
    cells = case.answer["where"]
    if not cells:
        return None
    measure = str(max(cells, key=lambda cell: abs(cell["gap"]))["mop"]).lower()
    return next((effect for word, effect in BLAMED if word in measure), None)


def case_features(folder: Path) -> pd.Series:
    """Return means and spreads over the drives of a case of the plain statistics of each."""
    drives = [
        raw_measures(read_table(file), read_table(file.with_name(file.name.replace("_subject", "_objects"))))
        for file in sorted((folder / "field").glob("*_subject.*"))
    ]
    table = pd.DataFrame(drives)
    return pd.concat([table.mean().add_prefix("mean_"), table.std().add_prefix("sd_")])


def forest_answers(cases: Sequence[Answered], more: Sequence[tuple[Path, str]]) -> list[str]:
    """Return what a random forest on plain statistics says of each case that it was not trained on.

    Further folders come with their truths, and are always trained on.
    """
    features = pd.DataFrame([case_features(case.folder) for case in cases])
    truths = np.asarray([case.truth for case in cases], dtype=object)
    other = pd.DataFrame([case_features(folder) for folder, _ in more], columns=features.columns)
    other_truths = np.asarray([truth for _, truth in more], dtype=object)
    said = np.full(len(cases), "none", dtype=object)
    if len(cases) < 2:
        return list(said)
    for train, test in KFold(min(MOST_FOLDS, len(cases)), shuffle=True, random_state=0).split(features):
        rows = pd.concat([features.iloc[train], other]) if len(other) else features.iloc[train]
        forest = make_pipeline(
            SimpleImputer(keep_empty_features=True),
            RandomForestClassifier(500, class_weight="balanced", random_state=0, n_jobs=1),
        )
        forest.fit(rows.to_numpy(), np.concatenate([truths[train], other_truths]).astype(str))
        said[test] = forest.predict(features.iloc[test].to_numpy())
    return [str(effect) for effect in said]
