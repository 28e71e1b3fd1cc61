"""Draws what is done to a copy of a case: which of its files, which mutation, how often."""

import shutil
import xml.etree.ElementTree as ET
import zlib
from pathlib import Path

import numpy as np
import pandas as pd

from experiments.faults.mutated_cases.byte_mutations import BYTE_MUTATIONS
from experiments.faults.mutated_cases.case_mutations import CASE_MUTATIONS
from experiments.faults.mutated_cases.log_mutations import LOG_MUTATIONS, spoil_table
from experiments.faults.mutated_cases.xml_mutations import TEXT_MUTATIONS, TREE_MUTATIONS
from jaxcalib.case.case_file import FILE_NAME

KINDS = {"logs": 0.4, "case": 0.25, "scenario": 0.35}  # how often files of a kind are spoilt
SCENARIO_FILES = {"demand.rou.xml": 0.5, "net.net.xml": 0.25, "scenario.sumocfg": 0.25}
BYTES_SHARE = 0.2  # of mutations that know nothing of a file's form
CSV_SHARE = 0.4  # of cases that have their logs in CSV
SECOND_SHARE = 0.15  # of cases in which a second file, or the same again, is spoilt
TEXT_SHARE = 0.3  # of the mutations of XML that do not care for its tree


def spoil_case(sound: Path, folder: Path, chance: np.random.Generator) -> tuple[str, list[str]]:
    """Write a copy of a sound case with one or two mutations.

    Args:
        sound: the case that is copied.
        folder: where the copy goes.
        chance: decides what is done.

    Returns:
        What was done, and the names of the files that it was done to.
    """
    shutil.copytree(sound, folder)
    if chance.random() < CSV_SHARE:
        _logs_as_csv(folder, is_packed=bool(chance.random() < 0.5))
    words, files = [], []
    for _ in range(1 + int(chance.random() < SECOND_SHARE)):
        kind = str(chance.choice(list(KINDS), p=list(KINDS.values())))
        file = _file_of(folder, kind, chance)
        if not file.is_file():
            continue  # the first mutation has taken it away
        words.append(f"{file.name}: {_spoil_until_another(file, kind, chance)}")
        files.append(file.name)
    return "; ".join(words), files


def _logs_as_csv(folder: Path, is_packed: bool) -> None:
    ending = ".csv.gz" if is_packed else ".csv"
    for file in sorted((folder / "field").glob("*.parquet")):
        pd.read_parquet(file).to_csv(file.with_name(f"{file.stem}{ending}"), index=False)
        file.unlink()
    toml = folder / FILE_NAME
    toml.write_text(toml.read_text(encoding="utf-8").replace(".parquet", ending), encoding="utf-8")


def _file_of(folder: Path, kind: str, chance: np.random.Generator) -> Path:
    if kind == "case":
        return folder / FILE_NAME
    if kind == "scenario":
        return folder / "scenario" / str(chance.choice(list(SCENARIO_FILES), p=list(SCENARIO_FILES.values())))
    logs = sorted((folder / "field").iterdir())
    return logs[int(chance.integers(len(logs)))] if logs else folder / FILE_NAME


def _spoil_until_another(file: Path, kind: str, chance: np.random.Generator) -> str:
    """Draw mutations until one has changed the file: some find nothing to change."""
    before = file.read_bytes()
    while True:
        words = _spoil(file, kind, chance)
        if words and (not file.is_file() or file.read_bytes() != before):
            return words


def _spoil(file: Path, kind: str, chance: np.random.Generator) -> str:
    if chance.random() < BYTES_SHARE:
        return BYTE_MUTATIONS[str(chance.choice(list(BYTE_MUTATIONS)))](file, chance)
    try:
        if kind == "logs":
            return spoil_table(file, LOG_MUTATIONS[str(chance.choice(list(LOG_MUTATIONS)))], chance)
        if kind == "case":
            lines = file.read_text(encoding="utf-8").splitlines()
            words = CASE_MUTATIONS[str(chance.choice(list(CASE_MUTATIONS)))](lines, chance)
            file.write_text("\n".join(lines) + "\n", encoding="utf-8")
            return words
        return _spoil_xml(file, chance)
    except (OSError, EOFError, zlib.error, ValueError, KeyError, IndexError, ET.ParseError):
        # a file that an earlier mutation has spoilt has no form any more
        return BYTE_MUTATIONS["flipped"](file, chance)


def _spoil_xml(file: Path, chance: np.random.Generator) -> str:
    if chance.random() < TEXT_SHARE:
        spoilt, words = TEXT_MUTATIONS[str(chance.choice(list(TEXT_MUTATIONS)))](file.read_text("utf-8"), chance)
        file.write_text(spoilt, encoding="utf-8")
        return words
    tree = ET.parse(file)
    words = TREE_MUTATIONS[str(chance.choice(list(TREE_MUTATIONS)))](tree.getroot(), chance)
    tree.write(file, encoding="utf-8", xml_declaration=True)
    return words
