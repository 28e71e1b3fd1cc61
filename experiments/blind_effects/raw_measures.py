"""Plain statistics of a drive's log, with no model behind them: for manipulation checks and for a naive baseline."""

from pathlib import Path

import numpy as np
import pandas as pd

KMH_PER_MPS = 3.6


def read_table(file: Path) -> pd.DataFrame:
    """Return a log's table, CSV or Parquet."""
    return pd.read_parquet(file) if file.suffix == ".parquet" else pd.read_csv(file)


def raw_measures(subject: pd.DataFrame, objects: pd.DataFrame) -> dict[str, float]:
    """Return statistics of one drive; NaN where there is nothing to count."""
    own = subject.sort_values("time_s").set_index("time_s")
    rows = objects.sort_values(["vehicle_id", "time_s"])
    speed_mps = rows.speed_kmh / KMH_PER_MPS
    is_next = rows.vehicle_id.eq(rows.vehicle_id.shift())
    step_s = rows.time_s.diff().where(is_next & (rows.time_s.diff() < 1.0))
    acceleration = speed_mps.diff() / step_s
    ego_mps = own.speed_kmh.reindex(rows.time_s).to_numpy() / KMH_PER_MPS
    closing = rows.relative_x_m.diff() / step_s - (speed_mps - ego_mps)
    jerk = acceleration.diff() / step_s
    ego_lane = own.lane.reindex(rows.time_s).to_numpy()
    is_leader = (rows.lane.to_numpy() == ego_lane) & (rows.relative_x_m > 0)
    leader_m = rows.relative_x_m[is_leader].groupby(rows.time_s[is_leader]).min()
    own_mps = own.speed_kmh.reindex(leader_m.index) / KMH_PER_MPS
    gaps_s = _following_time_headways_s(objects)
    minutes = max((own.index[-1] - own.index[0]) / 60.0, 1e-9)
    changes = (rows.relative_y_m.diff().abs() > 2.0) & is_next
    durations_s = rows.groupby("vehicle_id").time_s.agg(np.ptp)
    from_left = (-rows.relative_y_m).round(0)
    acceleration_own = own.acceleration_mps2
    measures = {
        "subject_speed_mean": own.speed_kmh.mean() / KMH_PER_MPS,
        "subject_speed_sd": own.speed_kmh.std() / KMH_PER_MPS,
        "subject_speed_min": own.speed_kmh.min() / KMH_PER_MPS,
        "subject_acceleration_sd": acceleration_own.std(),
        "subject_acceleration_held": float((acceleration_own.diff() == 0.0).mean()),
        "subject_time_headway": float((leader_m / own_mps.clip(lower=1.0)).median()),
        "subject_lane_changes": float((own.lane.diff().abs() > 0).sum()) / minutes,
        "traffic_speed_mean": speed_mps.mean(),
        "traffic_speed_sd": speed_mps.std(),
        "traffic_speed_p10": speed_mps.quantile(0.1),
        "traffic_speed_p90": speed_mps.quantile(0.9),
        "traffic_acceleration_sd": acceleration.clip(-10, 10).std(),
        "traffic_acceleration_held": float((acceleration.diff().abs() < 1e-3).mean()),
        "traffic_jerk_sd": jerk.clip(-100, 100).std(),
        "gap_rate_residual_mean": closing.clip(-30, 30).mean(),
        "gap_rate_residual_sd": closing.clip(-30, 30).std(),
        "objects_per_frame": len(rows) / max(len(own), 1),
        "objects_per_minute": rows.vehicle_id.nunique() / minutes,
        "object_seen_s": durations_s.median(),
        "object_farthest_m": rows.relative_x_m.abs().quantile(0.99),
        "object_lane_changes": float(changes.sum()) / minutes,
        "between_lanes_share": float((rows.heading_deg.abs() > 0.2).mean()),
        "left_share": float((from_left <= 0).mean()),
        "right_share": float((rows.lane == 1).mean()),
        "slow_share": float((speed_mps < 8.0).mean()),
        "standing_share": float((speed_mps < 0.5).mean()),
        "time_headway_p10": float(np.nanquantile(gaps_s, 0.1)) if len(gaps_s) else np.nan,
        "time_headway_median": float(np.nanmedian(gaps_s)) if len(gaps_s) else np.nan,
        "time_headway_p90": float(np.nanquantile(gaps_s, 0.9)) if len(gaps_s) else np.nan,
    }
    ends = np.linspace(own.index[0], own.index[-1], 6)
    for number in range(5):
        part = own.loc[ends[number] : ends[number + 1]]
        measures[f"speed_of_fifth_{number + 1}"] = part.speed_kmh.mean() / KMH_PER_MPS
    return {name: float(value) for name, value in measures.items()}


def _following_time_headways_s(objects: pd.DataFrame) -> np.ndarray:
    """Return time headways between objects that are neighbours in a lane."""
    rows = objects.sort_values(["time_s", "lane", "relative_x_m"])
    is_pair = rows.time_s.eq(rows.time_s.shift(-1)) & rows.lane.eq(rows.lane.shift(-1))
    spacing_m = (rows.relative_x_m.shift(-1) - rows.relative_x_m)[is_pair]
    speed_mps = (rows.speed_kmh / KMH_PER_MPS)[is_pair].clip(lower=1.0)
    headway_s = (spacing_m / speed_mps).to_numpy()
    return headway_s[headway_s < 5.0]
