"""The errors of a calibration as they stand in its result."""

from typing import Any

from jaxcalib.calibration.confirmation.final_errors import FinalErrors
from jaxcalib.calibration.objective.accuracy import TRAFFIC_LEVEL, VEHICLE_LEVEL_SUM
from jaxcalib.calibration.result.result import rounded

ErrorsByRole = dict[str, dict[Any, FinalErrors | None]]
LEVELS = {"single vehicles": (VEHICLE_LEVEL_SUM,), "the traffic flow": TRAFFIC_LEVEL}


def effectiveness_table(errors: ErrorsByRole, notes: dict[str, str]) -> dict[str, dict[str, dict[str, float | None]]]:
    """Return the errors of Eqs. 24-36 with their noise floor, by calibration and role; notes say why one is null."""
    moes: dict[str, dict[str, dict[str, float | None]]] = {}
    for calibration, by_role in errors.items():
        moes[calibration] = {}
        for role, one in by_role.items():
            moes[calibration][role] = {name: rounded(error) for name, error in one.pooled.errors.items()} if one else {}
            notes |= {f"moes.{calibration}.{role}.{k}": v for k, v in (one.pooled.notes.items() if one else ())}
    moes["noise_floor"] = {role: _floor_table(one) if one else {} for role, one in errors["calibrated"].items()}
    return moes


def _floor_table(errors: FinalErrors) -> dict[str, float | None]:
    """Return the noise floor of each measure; what drives do not show has no error, and no floor either."""
    is_shown = {name: rounded(errors.error(name)) is not None for name in errors.floor}
    return {name: rounded(floor) if is_shown[name] else None for name, floor in errors.floor.items()}


def vehicle_level_table(errors: ErrorsByRole) -> dict[str, dict[str, Any]]:
    """Return Eq. 23 with its interval or quantile, by calibration and role."""
    table: dict[str, dict[str, Any]] = {}
    for calibration, by_role in errors.items():
        table[calibration] = {
            role: {"value": rounded(one.pooled.vehicle_level), "interval_90": one.interval[VEHICLE_LEVEL_SUM]}
            for role, one in by_role.items()
            if one
        }
    table["noise_floor"] = {
        role: {"value": rounded(one.floor_vehicle_level), "quantile_95": rounded(one.floor_high[VEHICLE_LEVEL_SUM])}
        for role, one in errors["calibrated"].items()
        if one
    }
    return table


def part_by_role(errors: ErrorsByRole, part: Any) -> dict[str, Any]:
    """Return a part of the errors, by calibration and role."""
    return {
        calibration: {role: part(one) if one else {} for role, one in by_role.items()}
        for calibration, by_role in errors.items()
    }


def change_table(errors: ErrorsByRole) -> dict[str, Any]:
    """Return errors calibrated less those uncalibrated, by role."""
    table: dict[str, Any] = {}
    for role, after in errors["calibrated"].items():
        before = errors["no_calibration"][role]
        changes = after.change_since(before) if after and before else {}
        table[role] = {
            name: {"value": rounded(one.value), "interval_90": one.interval_90} for name, one in changes.items()
        }
    return table


def held_out_warnings(errors: ErrorsByRole) -> list[str]:
    """Return where held-out drives agree less with calibrated values than with the scenario's, beyond chance.

    Chance is the 95 % quantile of what such drives of the calibrated simulation err by; of several errors the mean of
    their quantiles, which is no less than that of their mean where they hang together.
    """
    before, after = errors["no_calibration"].get("held_out"), errors["calibrated"].get("held_out")
    if before is None or after is None:
        return []
    lines = []
    for level, names in LEVELS.items():
        of_each = [(before.error(name), after.error(name), after.floor_high[name]) for name in names]
        known = [(was, now, high) for was, now, high in of_each if None not in (was, now, high)]
        if not known:
            continue
        was, now, high = (sum(parts) / len(known) for parts in zip(*known, strict=True))
        if now > max(was, high):
            lines.append(
                f"Held-out drives do not confirm the calibrated values for {level}: the error is {now:.2f}, with the "
                f"scenario's values {was:.2f}, and chance explains up to {high:.2f}. The drives to fit are too few, or "
                "the others were made in other traffic: record more, or calibrate on some of each."
            )
    return lines
