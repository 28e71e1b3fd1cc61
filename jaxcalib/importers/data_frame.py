"""pandas' tables, unchecked: its annotations call many a column something else than what it is."""

from typing import Any, TypeAlias

Frame: TypeAlias = Any  # pandas.DataFrame, or a row or column of one
