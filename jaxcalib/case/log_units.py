"""From section [log] of case.toml to the form of the tables: units by pint, places by pyproj."""

from functools import cache
from pathlib import Path
from typing import Any

from jaxcalib.case.case_file import FILE_NAME
from jaxcalib.case.log_form import UNITS, LogColumn, LogForm
from jaxcalib.case.log_section import ColumnsSection, LogSection
from jaxcalib.errors import CaseError, quote, shorten


def log_form_of(section: LogSection | None, file: Path | str = FILE_NAME) -> LogForm:
    """Return how tables are written.

    Args:
        section: the section; None for Table 1.
        file: where it stands, for messages.

    Raises:
        CaseError: a unit or a coordinate reference system is unknown, or the unit is one of something else.
    """
    if section is None:
        return LogForm()
    common = _columns(file, "columns", section.columns)
    if section.crs is not None:
        check_crs(section.crs, file, "log.crs")
    return LogForm(
        subject=common | _columns(file, "subject_columns", section.subject_columns),
        objects=common | _columns(file, "object_columns", section.object_columns),
        absent=frozenset(section.absent),
        first_lane=section.first_lane,
        lanes_from=section.lanes_from,
        crs=section.crs,
        reference=section.reference,
        subject_length_m=section.subject_length_m,
        empty_road=section.empty_road,
    )


def _columns(file: Path | str, key: str, section: ColumnsSection | None) -> dict[str, LogColumn]:
    if section is None:
        return {}
    return {
        column: LogColumn(
            entry.column, _factor(file, f"log.{key}.{column}.unit", entry.unit, column), entry.zero or 0.0
        )
        for column in section.__struct_fields__
        if (entry := getattr(section, column)) is not None
    }


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


def _factor(file: Path | str, place: str, unit: str | None, column: str) -> float:
    if unit is None:
        return 1.0
    if column not in UNITS:
        raise CaseError(file, place, f"expected none, for {column} has no unit; got {quote(unit)}.")
    import pint  # half a second, as its registry, which most cases need not spend

    try:
        return float(_registry().Quantity(1.0, unit).to(UNITS[column]).magnitude)
    except pint.DimensionalityError:
        expected = f"expected a unit that can be turned into {UNITS[column]}, got {quote(unit)}."
    except Exception:  # whatever the library makes of text that is no unit: its own errors, Python's, the tokenizer's
        expected = f"expected a unit as pint knows them (m/s, mph, ft, deg, ms), got {quote(unit)}."
    raise CaseError(file, place, expected)


def check_crs(crs: str, file: Path | str, place: str) -> None:
    """Raise a CaseError for what names no coordinate reference system."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        CRS.from_user_input(crs)
    except CRSError as error:
        expected = f'expected a coordinate reference system, for example "EPSG:25832": {shorten(str(error), 150)}'
        raise CaseError(file, place, expected) from None
