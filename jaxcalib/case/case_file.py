"""What stands in case.toml, read and checked key by key, with errors in the words of the file's users."""

import difflib
import re
import tomllib
import typing
from collections.abc import Iterator
from pathlib import Path
from types import UnionType
from typing import Annotated, Any

import msgspec

from jaxcalib.case.case_sections import CaseTable
from jaxcalib.case.log_section import LogSection
from jaxcalib.errors import CaseError, quote, raise_faults, shorten

FILE_NAME = "case.toml"
CHECK_PAGE = "check.html"  # what a check draws beside it; no part of the case
LARGEST_BYTES = 65_536
MOST_DOTS = 20  # dotted keys cost quadratic time in the standard library's parser: 40 kB of them took 8.9 s


def read_case_table(folder: Path) -> CaseTable:
    """Read case.toml and check each key for itself.

    Raises:
        CaseError: the file is missing, too large or not TOML, a key is missing or unknown, a value has the wrong type
            or lies out of its range; the first fault, with the others.
    """
    return _converted(_parse(_text(folder / FILE_NAME)))


def _converted(data: dict[str, Any]) -> CaseTable:
    try:
        return msgspec.convert(data, CaseTable)
    except msgspec.ValidationError:
        raise_faults(_faults(data, data, CaseTable, []))
        raise
    except RecursionError:
        raise CaseError(FILE_NAME, "", "expected fewer levels of tables and lists in one another.") from None


def read_log_section(file: Path) -> tuple[LogSection, str]:
    """Read a file that holds nothing but section [log].

    Returns:
        The section, and the file's text.

    Raises:
        CaseError: as for case.toml, or it holds something else.
    """
    try:
        text = _text(file)
        data = _parse(text)
        if set(data) != {"log"}:
            raise CaseError(file, "", "expected section [log] (docs/case.md) and nothing else.")
        perception = {"ahead_m": 1.0, "behind_m": 1.0, "reference": "front", "nominal_length_m": 1.0}
        section = _converted({"format": 1, "name": "log", "perception": perception} | data).log
    except CaseError as error:
        first, *others = (CaseError(file, fault.place, fault.expected) for fault in (error, *error.others))
        first.others = tuple(others)
        raise first from None
    assert section is not None
    return section, text


def _text(file: Path) -> str:
    try:
        if not file.is_file():
            where = f"expected this file in the folder {quote(str(file.parent))}; there is none."
            raise CaseError(FILE_NAME, "", where)
        with file.open("rb") as stream:
            content = stream.read(LARGEST_BYTES + 1)
    except (OSError, ValueError) as error:
        if isinstance(error, CaseError):
            raise
        raise CaseError(FILE_NAME, "", f"expected a file that can be read: {shorten(str(error))}.") from None
    if len(content) > LARGEST_BYTES:
        raise CaseError(FILE_NAME, "", f"expected at most {LARGEST_BYTES // 1024} KiB.")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = content[: error.start].count(b"\n") + 1
        raise CaseError(FILE_NAME, f"line {row}", "expected UTF-8 text.") from None


def _parse(text: str) -> dict[str, Any]:
    for row, line in enumerate(text.split("\n"), start=1):
        if line.count(".") > MOST_DOTS and re.sub(r"\"[^\"]*\"|'[^']*'|#.*", "", line).count(".") > MOST_DOTS:
            raise CaseError(FILE_NAME, f"line {row}", f"expected at most {MOST_DOTS} dots outside of quotes.")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise CaseError(FILE_NAME, "", "expected fewer levels of tables and lists in one another.") from None
    except ValueError as error:
        raise CaseError(FILE_NAME, "", f"expected TOML: {shorten(str(error), 150)}.") from None


def _faults(root: Any, value: Any, annotation: Any, path: list[str | int]) -> Iterator[CaseError]:
    """Say the same as msgspec in our words, of every key: as the user wrote it, what was expected, what stands there.

    msgspec stops at the first fault, and its messages may contain the stranger's own text.
    """
    table = _bare(annotation)
    if isinstance(value, list) and typing.get_origin(table) is tuple and _is_table(typing.get_args(table)[0]):
        for index, item in enumerate(value):
            yield from _faults(root, item, typing.get_args(table)[0], [*path, index])
        return
    if not isinstance(value, dict) or not _is_table(table):
        try:
            msgspec.convert(value, annotation)
        except msgspec.ValidationError as error:
            yield _wrong_value(root, [*path, *_steps(str(error))])
        return
    known = _fields(table)
    for key in value:
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1)
            hint = f'did you mean "{close[0]}"?' if close else f"the keys here are {', '.join(known)}."
            yield CaseError(FILE_NAME, _place([*path, key], root), f"expected no such key; {hint}")
    for field in msgspec.structs.fields(table):
        here = [*path, field.name]
        if field.name in value:
            yield from _faults(root, value[field.name], known[field.name], here)
        elif field.required:
            yield CaseError(FILE_NAME, _place(here, root), f"expected {_description(here)}; missing.")


def _wrong_value(root: Any, path: list[str | int]) -> CaseError:
    value: Any = root
    for step in path:
        value = value[step]
    return CaseError(FILE_NAME, _place(path, root), f"expected {_description(path)}, got {quote(value)}.")


def _is_table(annotation: Any) -> bool:
    table = _bare(annotation)
    return isinstance(table, type) and issubclass(table, msgspec.Struct)


def _steps(message: str) -> list[str | int]:
    """Return the path that ends a message of msgspec, for example ` - at `$.drive[1].id`; nothing without one."""
    _, is_there, where = message.rpartition(" - at `$")
    if not is_there:
        return []
    return [int(index) if index else key for key, index in re.findall(r"\.(\w+)|\[(\d+)\]", where)]


def _place(path: list[str | int], data: Any) -> str:
    """Return a path as messages show it; [[drive]] and [[input]] by their id, or counted from 1."""
    place = ""
    for step in path:
        data = data[step] if isinstance(step, int) else data.get(step) if isinstance(data, dict) else None
        if isinstance(step, int):
            name = data.get("id") if isinstance(data, dict) else None
            place += f"[{shorten(name) if isinstance(name, str) else step + 1}]"
        else:
            place += f".{shorten(step)}" if place else shorten(step)
    return place


def _annotation(path: list[str | int]) -> Any:
    """Return the declared type at a path."""
    here: Any = CaseTable
    for step in path:
        bare = _bare(here)
        here = typing.get_args(bare)[0] if isinstance(step, int) else _fields(bare)[step]
    return here


def _bare(annotation: Any) -> Any:
    """Return a type without what `Annotated` and `| None` add to it."""
    if typing.get_origin(annotation) is Annotated:
        return _bare(typing.get_args(annotation)[0])
    if isinstance(annotation, UnionType) or typing.get_origin(annotation) is typing.Union:
        return _bare(typing.get_args(annotation)[0])
    return annotation


def _fields(table: Any) -> dict[str, Any]:
    return typing.get_type_hints(_bare(table), include_extras=True)


def _description(path: list[str | int]) -> str:
    annotation = _annotation(path)
    if isinstance(annotation, UnionType) or typing.get_origin(annotation) is typing.Union:
        annotation = typing.get_args(annotation)[0]
    if typing.get_origin(annotation) is Annotated:
        return next(meta.description for meta in typing.get_args(annotation)[1:] if meta.description)
    if typing.get_origin(annotation) is tuple:
        return f"one or more tables [[{path[-1]}]]"
    return f"a table [{path[-1]}]" if isinstance(path[-1], str) else "a table"
