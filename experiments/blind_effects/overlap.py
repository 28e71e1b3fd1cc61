"""Overlap over union of where an effect acts and where it was said to act."""

from typing import Any

import numpy as np

from experiments.blind_effects.answers import Answered

STEP_M, STEP_S = 10.0, 5.0
LEAST_PLACE_M = 100.0  # a vehicle that stands is a point; no answer in cells could ever meet it
SIGNIFICANT = 0.1
Span = tuple[float, float]


def true_place(case: Answered) -> dict[str, Any] | None:
    """Return the place of the only effect, widened to what can be told; None where it has none."""
    place = case.label["place_and_time"]
    if case.kind != "single" or "route_from_m" not in place:
        return None
    middle_m = 0.5 * (place["route_from_m"] + place["route_to_m"])
    half_m = max(0.5 * LEAST_PLACE_M, 0.5 * (place["route_to_m"] - place["route_from_m"]))
    return place | {"route_from_m": middle_m - half_m, "route_to_m": middle_m + half_m}


def answered_cells(case: Answered) -> list[dict[str, Any]]:
    """Return the cells in which the answer places the gap.

    If the ranking's entry of the true effect has a place of its own, it is that. Else the cells of `where` with an
    adjusted probability of 0.1 at most; of those with times, if any have; else the one with the largest share.
    """
    for entry in case.answer["ranking"]:
        if entry["effect"] == case.truth and entry.get("route_from_m") is not None:
            return [entry]
    cells = [cell for cell in case.answer["where"] if cell.get("route_from_m") is not None]
    if not cells:
        return []
    certain = [
        cell for cell in cells if (cell.get("p_adjusted") or 0.0) <= SIGNIFICANT and cell.get("share", 0.0) > 0.0
    ]
    return certain or [max(cells, key=lambda cell: cell.get("share", 0.0))]


def overlap_over_union(truth: dict[str, Any], cells: list[dict[str, Any]]) -> float:
    """Return the overlap over the union of areas in route x time; a missing or empty time is all the time.

    Cells may overlap.
    """
    if not cells:
        return 0.0
    rows = [truth, *cells]
    first_m = min(row["route_from_m"] for row in rows)
    last_m = max(row["route_to_m"] for row in rows)
    has_time = truth.get("time_from_s") is not None
    spans = [_times(row) for row in rows] if has_time else [(0.0, STEP_S)] * len(rows)
    known = [span for span in spans if span is not None]
    first_s, last_s = min(span[0] for span in known), max(span[1] for span in known)
    if any(span is None for span in spans):
        first_s, last_s = min(first_s, 300.0), max(last_s, 720.0)
    at_m = np.arange(first_m + 0.5 * STEP_M, last_m, STEP_M)[:, None]
    at_s = np.arange(first_s + 0.5 * STEP_S, last_s, STEP_S)[None, :]

    def covers(row: dict[str, Any], span: Span | None) -> np.ndarray:
        begin_s, end_s = span or (first_s, last_s)
        return (at_m >= row["route_from_m"]) & (at_m < row["route_to_m"]) & (at_s >= begin_s) & (at_s < end_s)

    true_area = covers(rows[0], spans[0])
    said_area = np.any([covers(row, span) for row, span in zip(rows[1:], spans[1:], strict=True)], axis=0)
    union = np.count_nonzero(true_area | said_area)
    return float(np.count_nonzero(true_area & said_area) / union) if union else 0.0


def _times(row: dict[str, Any]) -> Span | None:
    if row.get("time_from_s") is None or row.get("time_to_s") is None:
        return None
    return float(row["time_from_s"]), float(row["time_to_s"])
