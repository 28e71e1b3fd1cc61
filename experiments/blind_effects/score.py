"""The table: what was named, what was not, and whether anybody could have guessed it."""

import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from experiments.blind_effects.answers import NO_EFFECT, Answered, read_answers
from experiments.blind_effects.naive import forest_answers, largest_error, largest_gain
from experiments.blind_effects.overlap import answered_cells, overlap_over_union, true_place
from experiments.blind_effects.rates import paired_difference, rate
from experiments.blind_effects.run import case_folders
from experiments.blind_effects.score_table import Line, show, write_page

MOST_IN_SET = 3
SET_PROBABILITY = 0.9
LEVELS = ("weak", "medium", "strong")


def is_named(case: Answered) -> bool:
    """Return whether the true effect was named, alone or in a set of at most 3."""
    return case.truth in case.named and len(case.named) <= MOST_IN_SET


def is_named_alone(case: Answered) -> bool:
    """Return whether the true effect and nothing else was named."""
    return case.named == (case.truth,)


def is_other_named(case: Answered) -> bool:
    """Return whether effects were named, and the true one is not among them."""
    return bool(case.named) and case.truth not in case.named


def is_false_alarm(case: Answered) -> bool:
    """Return whether a case without an effect was said to have one, known or unknown."""
    return case.verdict not in (*NO_EFFECT, "not_testable")


def is_unknown(case: Answered) -> bool:
    """Return whether the verdict is that no known effect fits."""
    return case.verdict == "unknown"


def likely_set(case: Answered) -> tuple[str, ...]:
    """Return the smallest set of candidates whose probabilities sum to 0.9."""
    entries = sorted(case.answer["ranking"], key=lambda entry: -entry["probability"])
    sums = np.cumsum([entry["probability"] for entry in entries])
    needed = int(np.searchsorted(sums, SET_PROBABILITY - 1e-9)) + 1
    return tuple(entry["effect"] for entry in entries[:needed])


def score(cases: Sequence[Answered], forest: Sequence[str]) -> list[Line]:
    """Return the lines of the table."""
    single = [case for case in cases if case.kind == "single"]
    clear = [case for case in single if case.level in ("medium", "strong")]
    of_kind: Callable[[str], list[Answered]] = lambda kind: [case for case in cases if case.kind == kind]  # noqa: E731
    in_library = [case for case in cases if case.kind in ("single", "null", "null_far")]
    lines = [
        _share("the true effect named, alone or in a set of at most 3 (medium and strong)", is_named, clear, 0.55, 0.8),
        _share("the same, alone", is_named_alone, clear, 0.4, 0.7),
        _share("another effect named instead, at any strength", is_other_named, single, 0.2, 0.05, is_most=True),
    ]
    for level in LEVELS:
        some = [case for case in single if case.level == level]
        lines.append(_share(f"named, {level} effects", is_named, some))
        lines.append(_share(f"named alone, {level} effects", is_named_alone, some))
    counts = sorted({_num_drives(case) for case in clear})
    for count in counts if len(counts) > 1 else ():
        some = [case for case in clear if _num_drives(case) == count]
        lines.append(_share(f"named, {count} drives (medium and strong)", is_named, some))
    roads = sorted({str(case.label.get("road", "")) for case in clear} - {""})
    for road in roads if len(roads) > 1 else ():
        lines.append(_share(f"named, road {road}", is_named, [case for case in clear if case.label["road"] == road]))
    lines += [
        _share("false alarms on nulls", is_false_alarm, of_kind("null"), 0.1, 0.03, is_most=True),
        _share("false alarms on pure miscalibrations", is_false_alarm, of_kind("null_far"), 0.1, 0.03, is_most=True),
        _share("unknown, on effects outside the library", is_unknown, of_kind("out_of_library"), 0.4, 0.7),
        _share("false unknowns (single effects and nulls)", is_unknown, in_library, 0.1, 0.1, is_most=True),
        _share("an effect named, outside the library", lambda case: bool(case.named), of_kind("out_of_library")),
        _share("an effect named, other baseline model", lambda case: bool(case.named), of_kind("other_model")),
        _share("unknown, other baseline model", is_unknown, of_kind("other_model")),
        _share("pairs: at least one of the two named", _is_one_of_pair, of_kind("pair")),
        _share("pairs: both named", lambda case: set(case.true_effects) <= set(case.named), of_kind("pair")),
        _share("90 % sets hold the truth", lambda case: case.truth in likely_set(case), in_library, 0.85, 0.9),
        _number("mean size of 90 % sets", [len(likely_set(case)) for case in in_library], np.mean),
    ]
    lines += _strength_lines(single) + _fraction_lines(cases) + _place_lines(single)
    walls = [float(case.answer["wall_s"]["total"]) for case in cases]
    lines.append(_number("wall time, median (s)", walls, np.median, 600.0, 180.0, is_most=True))
    lines.append(_number("wall time, longest (s)", walls, np.max))
    return lines + _naive_lines(cases, clear, forest)


def is_visible(case: Answered) -> bool:
    """Return whether the answer's power table says that an effect of the true strength would be seen."""
    least = case.answer.get("undetectable_below", {}).get(case.truth)
    return least is not None and _true_strength(case) >= abs(least)


def holds_strength(case: Answered) -> bool:
    """Return whether the interval of the true effect's strength holds it; signs are the label's, sizes count."""
    entry = next(one for one in case.answer["ranking"] if one["effect"] == case.truth)
    if entry.get("strength_ci90") is None:
        return False
    low, high = sorted(abs(bound) for bound in entry["strength_ci90"])
    return low <= _true_strength(case) <= high


def _true_strength(case: Answered) -> float:
    return abs(float(case.label["effects"][0]["strength"]))


def _strength_lines(single: Sequence[Answered]) -> list[Line]:
    named = [case for case in single if case.truth in case.named]
    seen = [case for case in single if is_visible(case)]
    return [
        _share("named, of those that the power table calls visible", is_named, seen, 0.75, 0.9),
        _share("90 % intervals hold the true strength, of effects named", holds_strength, named, 0.85, 0.9),
    ]


def _is_one_of_pair(case: Answered) -> bool:
    return bool(set(case.true_effects) & set(case.named)) and len(case.named) <= MOST_IN_SET


def _num_drives(case: Answered) -> int:
    return int(case.label.get("num_drives") or len(list((case.folder / "field").glob("*_subject.*"))))


def _fraction_lines(cases: Sequence[Answered]) -> list[Line]:
    """The true fraction closed is that of the twin: the same fit, judged on many more held-out drives."""
    inside: list[bool] = []
    errors: list[float] = []
    for case in cases:
        ours, truth = case.answer.get("how_far"), (case.twin or {}).get("how_far")
        if not ours or not truth or ours.get("fraction_closed") is None or truth.get("fraction_closed") is None:
            continue
        errors.append(abs(ours["fraction_closed"] - truth["fraction_closed"]))
        low, high = ours["fraction_closed_ci90"]
        inside.append(low <= truth["fraction_closed"] <= high)
    return [
        Line.of_rate("90 % intervals hold the true fraction closed", rate(inside), 0.8, 0.9),
        _number("median error of the fraction closed", errors, np.median, 0.15, 0.07, is_most=True),
    ]


def _place_lines(single: Sequence[Answered]) -> list[Line]:
    named: list[float] = []
    every: list[float] = []
    for case in single:
        truth = true_place(case)
        if truth is None:
            continue
        value = overlap_over_union(truth, answered_cells(case)) if case.named else 0.0
        every.append(value)
        named += [value] if is_named(case) else []
    return [
        _number("place and time of local effects that were named: overlap over union", named, np.mean, 0.4, 0.65),
        _number("the same over all local effects, 0 where nothing is named", every, np.mean),
    ]


def _naive_lines(cases: Sequence[Answered], clear: Sequence[Answered], forest: Sequence[str]) -> list[Line]:
    said = {id(case): answer for case, answer in zip(cases, forest, strict=True)}
    baselines: dict[str, Callable[[Answered], str | None]] = {
        "effect that lowers the error most": largest_gain,
        "random forest on plain statistics": lambda case: said[id(case)],
        "largest error looked up": largest_error,
    }
    nulls = [case for case in cases if case.truth == "none"]
    known = [*clear, *nulls]
    right = [is_named_alone(case) or (case.truth == "none" and not is_false_alarm(case)) for case in known]
    lines: list[Line] = []
    for name, answer in baselines.items():
        theirs = [answer(case) for case in clear]
        if all(effect is None for effect in theirs):
            lines.append(Line(f"naive: {name}", None, note="the answers hold nothing to compute it from"))
            continue
        hits = [effect == case.truth for effect, case in zip(theirs, clear, strict=True)]
        lines.append(Line.of_rate(f"naive: {name}: true effect", rate(hits)))
        alarms = rate([answer(case) not in (None, "none") for case in nulls])
        lines.append(Line.of_rate(f"naive: {name}: false alarms without effect", alarms))
        lines.append(_more_often("named alone", name, [is_named_alone(case) for case in clear], hits))
        theirs_right = [(answer(case) or "none") == case.truth for case in known]
        lines.append(_more_often("named alone, or nothing named where nothing is", name, right, theirs_right))
    return lines


def _more_often(what: str, name: str, ours: Sequence[bool], theirs: Sequence[bool]) -> Line:
    step, low = paired_difference(ours, theirs)
    note = f"lower end of the 95 % interval {low:+.2f}; expected above 0"
    is_met = bool(low > 0.0) if ours else None
    return Line(f"{what}, more often than naive: {name}", step, len(ours), note=note, is_met=is_met)


def _share(
    title: str,
    mark: Callable[[Answered], bool],
    cases: Sequence[Answered],
    least: float | None = None,
    aim: float | None = None,
    *,
    is_most: bool = False,
) -> Line:
    return Line.of_rate(title, rate([mark(case) for case in cases]), least, aim, is_most=is_most)


def _number(
    title: str,
    values: Sequence[float],
    summary: Callable[[Any], Any],
    least: float | None = None,
    aim: float | None = None,
    *,
    is_most: bool = False,
) -> Line:
    value = float(summary(values)) if len(values) else None
    return Line.judged(title, value, len(values), least, aim, is_most=is_most)


def case_rows(cases: Iterable[Answered], forest: Sequence[str]) -> list[dict[str, Any]]:
    """Return one row per case for score.json and the page."""
    rows = []
    for case, says in zip(cases, forest, strict=True):
        check = case.label.get("manipulation_check", {})
        rows.append(
            {
                "case": case.folder.name,
                "kind": case.kind,
                "road": str(case.label.get("road", "")),
                "true": list(case.true_effects),
                "level": case.level,
                "strengths": [effect.get("strength") for effect in case.label["effects"]],
                "verdict": case.verdict,
                "named": list(case.named),
                "told": [_told(case, name) for name in case.named],
                "forest": says,
                "largest_gain": largest_gain(case),
                "largest_error": largest_error(case),
                "changed_beyond_seeds": check.get("beyond_seeds"),
                "wall_s": case.answer["wall_s"]["total"],
            }
        )
    return rows


def _told(case: Answered, name: str) -> str:
    """Return the strength of a named effect with its interval."""
    entry = next((one for one in case.answer["ranking"] if one["effect"] == name), {})
    if entry.get("strength") is None or not entry.get("strength_ci90"):
        return "-"
    low, high = entry["strength_ci90"]
    return f"{entry['strength']:.3g} ({low:.3g} to {high:.3g})"


def score_answers(
    cases: Path, runs: Path, key: Path | None, train: tuple[Path, ...], out: Path, console: Console
) -> tuple[list[Line], list[dict[str, Any]]]:
    """Read labels and answers, print the table, write score.json and score.html into a folder.

    Returns:
        The table's lines, and a row for each case.
    """
    answered, missing = read_answers(cases, runs, key)
    if not answered:
        raise SystemExit(f"{runs}: expected RUN/diagnosis.json of labelled cases, there is none.")
    if missing:
        console.print(f"[yellow]{len(missing)} cases have no answer and count nowhere: {', '.join(missing[:10])}")
    forest = forest_answers(answered, _labelled(train))
    lines = score(answered, forest)
    rows = case_rows(answered, forest)
    show(console, lines)
    out.mkdir(parents=True, exist_ok=True)
    content = {"format": 1, "unanswered": missing, "table": [line.as_dict() for line in lines], "cases": rows}
    (out / "score.json").write_text(json.dumps(content, indent=1), encoding="utf-8")
    write_page(out / "score.html", lines, rows, missing)
    console.print(f"written: {out / 'score.json'}, {out / 'score.html'}")
    return lines, rows


def _labelled(folders: tuple[Path, ...]) -> list[tuple[Path, str]]:
    """Return further cases with a label.json, and their truths."""
    labelled: list[tuple[Path, str]] = []
    for folder in folders:
        for case in case_folders(folder):
            if (case / "label.json").is_file():
                label = json.loads((case / "label.json").read_text(encoding="utf-8"))
                labelled.append((case, Answered(case, label, {}).truth))
    return labelled
