"""Within which margin simulation and field count as the same, quantity by quantity, and who says so."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from jaxcalib.errors import CaseError, shorten
from jaxcalib.measures.measure import Moe
from jaxcalib.validation.criterion import FHWA_2004, OWN

USER = "given with --margins"
MOST = 2.0  # a wider margin would call anything the same


@dataclass(frozen=True)
class Margin:
    """A margin."""

    share: float  # of the field's value, to either side
    source: str  # who says so


# No regulation states one. Where a guideline has a tolerance for the same quantity, it is taken; the rest are choices.
MARGINS: Mapping[Moe, Margin] = {
    Moe.SUBJECT_TIME_HEADWAY: Margin(0.1, OWN),
    Moe.BACKGROUND_TIME_HEADWAY: Margin(0.1, OWN),
    Moe.SUBJECT_LANE_CHANGE_DISTANCE: Margin(0.2, OWN),
    Moe.BACKGROUND_LANE_CHANGE_DISTANCE: Margin(0.2, OWN),
    Moe.CUT_INS: Margin(0.3, OWN),
    Moe.TRAFFIC_SPEED: Margin(0.15, f"{FHWA_2004}: travel times"),
    Moe.TRAFFIC_DENSITY: Margin(0.15, f"{OWN}: that of volume and speed"),
    Moe.TRAFFIC_VOLUME: Margin(0.15, f"{FHWA_2004}: volumes of 700 to 2,700 veh/h"),
    Moe.TRAFFIC_DYNAMICS: Margin(0.15, f"{FHWA_2004}: travel times"),
}


class _File(msgspec.Struct, forbid_unknown_fields=True):
    margins: dict[str, float]


def read_margins(file: Path | None) -> dict[Moe, Margin]:
    """Return the margins, with those that a user's file gives instead.

    Raises:
        CaseError: the file is missing or wrong.
    """
    margins = dict(MARGINS)
    if file is None:
        return margins
    try:
        given = msgspec.convert(tomllib.loads(file.read_text(encoding="utf-8")), _File).margins
    except OSError as error:
        raise CaseError(file, "", f"expected a file of margins: {shorten(error.strerror or str(error))}.") from None
    except (ValueError, RecursionError) as error:
        raise CaseError(file, "", f"expected TOML with section [margins]: {shorten(str(error), 150)}.") from None
    known = {str(moe.value): moe for moe in Moe}
    for name, share in given.items():
        if name not in known:
            raise CaseError(file, f"margins.{name}", f"expected one of {', '.join(known)}.")
        if not 0.0 < share <= MOST:
            raise CaseError(file, f"margins.{name}", f"expected a share above 0, at most {MOST:g}; got {share:g}.")
        margins[known[name]] = replace(margins[known[name]], share=share, source=USER)
    return margins
