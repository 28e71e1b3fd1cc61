"""The dossier says what files show and names what is missing; results are made up, the case is corridor."""

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from jaxcalib.cli.app import app
from jaxcalib.dossier import evidence
from jaxcalib.dossier.dossier import HEADINGS, write_dossier
from jaxcalib.dossier.evidence import STATED
from jaxcalib.dossier.use_and_data import ASKED_OF_PEOPLE
from jaxcalib.errors import CaseError
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.runs.provenance import versions
from tests.places import CORRIDOR

NOTHING: dict[str, Any] = {"fit": {}, "held_out": {}}


@pytest.fixture(scope="module")
def problem() -> CalibrationProblem:
    return read_problem(CORRIDOR)


@pytest.fixture(autouse=True)
def read_once(monkeypatch: pytest.MonkeyPatch, problem: CalibrationProblem):
    """The case is read once for all tests but those that alter a copy of it."""
    monkeypatch.setattr(evidence, "read_problem", lambda case: problem if case == CORRIDOR else read_problem(case))


def result_of(problem: CalibrationProblem) -> dict[str, Any]:
    """A result with one parameter that is told, one that is not, one error within chance and one beyond."""
    values, layout = problem.template.base_values().tolist(), problem.layout
    entry = {"scenario": 1.0, "initial": 1.1, "at_bound": False, "unit": "s", "source": "leader-follower pairs"}
    errors = {"traffic_speed": 0.02, "cut_ins": 0.31, "lane_change_distance": 0.9}
    return {
        "format": 1,
        "parameters": {
            "demand": dict(zip(layout.input_ids, values, strict=False)),
            "behaviour": {"car": dict(zip(layout.attributes, values[2:], strict=True))},
        },
        "seeds": {"search": 7},
        "parameter_table": {
            "tau": {**entry, "value": 1.2, "lower": 1.15, "upper": 1.26, "is_identified": True},
            "lcStrategic": {
                **entry,
                "value": 2.0,
                "lower": 0.3,
                "upper": 6.0,
                "source": "scenario",
                "is_identified": False,
            },
        },
        "moes": {
            "no_calibration": {"held_out": {"traffic_speed": 0.2, "cut_ins": 0.9}},
            "calibrated": {"held_out": errors},
            "noise_floor": {"held_out": {"traffic_speed": 0.02, "cut_ins": 0.1, "lane_change_distance": 0.7}},
        },
        "mops": {
            "field": {"fit": {}, "held_out": {"subject_ttc_exposed_share": 0.013, "traffic_speed_mps": 23.0}},
            "sumo": {"fit": {}, "held_out": {"subject_ttc_exposed_share": 0.021, "traffic_speed_mps": 22.0}},
        },
        "noise_floor_high": {"held_out": {"traffic_speed": 0.05, "cut_ins": 0.2, "lane_change_distance": 1.0}},
        "intervals": {"calibrated": {"held_out": {"traffic_speed": [0.01, 0.04], "cut_ins": [0.1, 0.5]}}},
        "per_seed": {"calibrated": {"held_out": {"traffic_speed": 0.03, "cut_ins": 0.4}}},
        "health": {
            "calibrated": {
                "runs": 20,
                "failed": 0,
                "unfinished": 14,
                "collisions": 3,
                "teleports": 0,
                "subject_overlaps": 0,
                "backlog_share": 0.00021,
            },
        },
        "confirmation": {
            "searched_in_sumo": False,
            "agreement": [{"where": "at the values found", "share_alike": 0.4, "holds": False}],
        },
        "runs": {"surrogate": 2204, "sumo": 52},
        "transfer": [{"measure": "free_speed_mps", "bias": -0.05, "bias_in_noise": -1.8}],
        "screening": {
            "stage1": {
                "array": "L9(3^2)",
                "cases_failed": 2,
                "parameters": [{"name": "main", "range": None, "range_of_noise": None, "p_value": None}],
            },
        },
        "commit": "abc",
        "scenario": [],
        "warnings": ["<b>a limit</b> of 3 lanes"],
        "versions": versions(),
    }


def validation_of(problem: CalibrationProblem) -> dict[str, Any]:
    """One criterion of each kind, one quantity of each verdict, one safety measure that is judged and one not."""
    one = {"standard": "jaxcalib", "is_upper": True, "note": "", "limit": 0.1}
    same = {"interval_90": [-0.02, 0.03], "margin": 0.15, "source": "FHWA 2004", "more_drives": 0, "note": ""}
    judged = {"field": 0.013, "num_observations": 41.0, "simulated": 0.03, "interval_90": [0.02, 0.04],
              "p_value": 0.001, "p_adjusted": 0.02, "is_beyond_chance": True}  # fmt: skip
    few = {"num_observations": 3.0, "interval_90": None, "p_value": None, "p_adjusted": None, "is_beyond_chance": None}
    scores = {"recall": 0.6, "precision": 0.7, "f1": 0.1, "among_simulated": 0.4, "limit": 0.2}
    severities = {"mild": 1.0, "medium": 2.0, "severe": None}
    values = problem.template.base_values().tolist()
    return {
        "format": 1,
        "case": problem.case.name,
        "parameters": dict(zip(problem.layout.names, values, strict=True)),
        "versions": versions(),
        "commit": "abc-changed",
        "role": "held_out",
        "drives": ["d03", "d06"],
        "num_rounds": 20,
        "seeds": [500000, 500039],
        "criteria": [
            {**one, "name": "teleports", "value": 0.0, "passes": True},
            {**one, "name": "collisions", "value": 0.4, "passes": False, "note": "in three runs"},
            {**one, "name": "GEH below 5", "value": None, "passes": None, "note": "needs counts"},
        ],
        "measures": {"subject_ttc_exposed_share": judged, "subject_drac_exposed_share": judged | few},
        "encounters": {
            "cut_in": {"field": severities, "simulated": severities, **scores},
            "all": {"field": None, "simulated": None, **scores},
        },
        "tails": {
            "subject": {"field": {"exceedances": 4.0, "level_mps2": None, "interval_90": None},
                        "simulated": {"exceedances": 40.0, "level_mps2": 1.2, "interval_90": [0.8, 2.0]}},
        },
        "equivalence": {
            "traffic_speed_mps": {**same, "difference": 0.005, "verdict": "equivalent"},
            "cut_ins_per_drive": {**same, "difference": 0.412, "verdict": "different"},
            "subject_time_headway_s": {**same, "difference": 0.1, "verdict": "not enough drives", "more_drives": 11},
            "volume": {**same, "difference": 0.14999, "verdict": "not enough drives", "more_drives": 999},
            "gap_m": {**same, "difference": None, "verdict": "not enough drives", "note": "fewer than 5 observations"},
        },
    }  # fmt: skip


DIAGNOSIS = {
    "format": 1,
    "verdict": "effect",
    "effects": ["reaction_delay"],
    "ranking": [{"effect": "reaction_delay", "probability": 0.97, "strength": 0.9, "strength_ci90": [0.8, 1.0]}],
    "how_far": {"fraction_closed": 0.8, "fraction_closed_ci90": [0.6, 1.0]},
    "undetectable_below": {"reaction_delay": 0.3, "keep_right": None},
    "next_steps": ["Put reaction delay into the simulation and calibrate again with it."],
}


def run_with(folder: Path, **files: dict[str, Any]) -> Path:
    """RUN with results of the given names, the others beside it."""
    for name, content in files.items():
        file = folder / ("result.json" if name == "result" else f"{name}/{name}.json")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(content))
    return folder


def missing_of(dossier, heading: str) -> str:
    (section,) = [section for section in dossier.sections if section.heading.startswith(heading)]
    return "\n".join(section.missing)


def test_every_heading_is_there_and_says_what_is_missing(problem: CalibrationProblem, tmp_path: Path):
    run = run_with(tmp_path / "run", result=result_of(problem))
    dossier = write_dossier(CORRIDOR, run)
    assert len(dossier.sections) == len(HEADINGS)
    assert all(section.missing or section.statements or section.tables for section in dossier.sections)
    assert len(dossier.sections[0].missing) == len(ASKED_OF_PEOPLE)
    assert set(ASKED_OF_PEOPLE) | {"accuracy_requirement"} == set(STATED)
    assert "jaxcalib validate" in missing_of(dossier, "Validation")
    assert "jaxcalib diagnose" in missing_of(dossier, "The gap")
    assert "lcStrategic" in missing_of(dossier, "Calibration")
    assert "tau" not in missing_of(dossier, "Calibration")
    assert dossier.num_missing == sum(len(section.missing) for section in dossier.sections)


def test_all_that_is_there_is_told_with_its_source(problem: CalibrationProblem, tmp_path: Path):
    statement = tmp_path / "statement.toml"
    statement.write_text('purpose = "Release of lane keeping."\n')
    run = run_with(tmp_path / "run", result=result_of(problem), validation=validation_of(problem), diagnosis=DIAGNOSIS)
    dossier = write_dossier(CORRIDOR, run, tmp_path / "out", statement=statement)
    assert missing_of(dossier, "Purpose").count("\n") == len(ASKED_OF_PEOPLE) - 2
    told = json.loads((tmp_path / "out/dossier.json").read_text())
    words = [one["text"] for section in told["sections"] for one in section["statements"]]
    assert all(one["source"] for section in told["sections"] for one in section["statements"] + section["tables"])
    against = [line for section in told["sections"] for line in section["failures"]]
    assert any("cut_ins_per_drive is known to differ by 41.2 %" in line for line in against)
    assert "Errors beyond chance on the held-out drives: cut ins." in against
    assert "collisions: 0.4, at most 0.1 (jaxcalib). in three runs" in against
    assert any(line.startswith("subject_ttc_exposed_share lies beyond") for line in against)
    assert sum("encounters are recalled worse" in line for line in against) == 1  # of all kinds together
    assert "One effect is missing in the simulation: reaction delay." in against
    assert dossier.num_failures == len(against) == 7
    assert "Not valid: 1 of 2 criteria fail." in words
    assert any("14 drives unfinished" in line for line in words)
    assert any("0.02 % of the demand" in line for line in words)
    assert "The calibration was made by commit abc." in words
    assert "lane_change_distance" not in missing_of(dossier, "Calibration")
    assert "tell an error of 100 % from chance: lane change distance" in missing_of(dossier, "Calibration")
    assert "only in 40% of the sections" in missing_of(dossier, "Model")
    assert any("3 vehicle steps in collision" in line for line in words)
    assert any("One effect is missing in the simulation: reaction delay." in line for line in words)
    validation = missing_of(dossier, "Validation")
    assert "GEH below 5 (jaxcalib): needs counts" in validation
    assert "subject_time_headway_s is the same within 15.0 %: not enough drives; 11 more would tell" in validation
    assert "volume is the same within 15.0 %: not enough drives; at least 999 more would tell" in validation
    assert "gap_m is the same within 15.0 %: fewer than 5 observations." in validation
    assert "rest on too little to be judged: subject_drac_exposed_share" in validation
    assert "too few exceedances or drives, subject in the field" in validation
    assert "traffic_speed_mps" not in validation
    assert "validation: abc-changed" in missing_of(dossier, "Versions")
    assert "--half-step" in missing_of(dossier, "Numerical")
    assert "keep right" in missing_of(dossier, "The gap")
    tables = {table["title"]: table["rows"] for section in told["sections"] for table in section["tables"]}
    assert tables["Safety measures on the held-out drives"] == [["subject_ttc_exposed_share", 0.013, 0.021]]
    assert "Safety measures on the fit drives" in missing_of(dossier, "Calibration")
    (table,) = [t for s in told["sections"] for t in s["tables"] if t["title"] == "Files"]
    hashes = dict(table["rows"])
    assert hashes["RUN/result.json"] == hashlib.sha256((run / "result.json").read_bytes()).hexdigest()
    assert {"CASE/case.toml", str(statement), "RUN/validation/validation.json"} < set(hashes)
    assert {"CASE/field/d01_subject.csv.gz", "CASE/scenario/net.net.xml"} < set(hashes)
    assert tables["Sensitivity in stage1, by L9(3^2), of which 2 cases failed, in the surrogate"] == [
        ["main", None, None, None]
    ]
    assert tables["Encounters around the subject vehicle"][0][:3] == ["cut in", 3.0, 3.0]
    assert tables["Safety measures"][0][:4] == ["subject_ttc_exposed_share", 0.013, 41.0, 0.03]
    page = (tmp_path / "out/dossier.html").read_text()
    assert "&lt;b&gt;a limit&lt;/b&gt;" in page
    assert "<script" not in page
    assert all(section.heading.split(",")[0] in page for section in dossier.sections)


def test_what_was_fitted_is_no_validation(problem: CalibrationProblem, tmp_path: Path):
    run = run_with(tmp_path, result=result_of(problem), validation={**validation_of(problem), "role": "fit"})
    assert "these were fitted" in missing_of(write_dossier(CORRIDOR, run), "Validation")


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("statement.toml", 'purpos = "x"', "statement.toml: purpos: expected one of purpose, scope"),
        ("statement.toml", "purpose = 3", "statement.toml: purpose: expected a text"),
        ("statement.toml", "purpose =", "expected TOML"),
        ("validation.json", "{", "validation.json: expected a result of jaxcalib"),
        ("validation.json", '{"format": 2}', "format: expected 1"),
    ],
)
def test_files_that_are_refused(problem: CalibrationProblem, tmp_path: Path, name: str, content: str, says: str):
    run = run_with(tmp_path / "run", result=result_of(problem))
    (tmp_path / name).write_text(content)
    given = {"statement": tmp_path / name} if name.startswith("statement") else {"validation_run": tmp_path}
    with pytest.raises(CaseError) as error:
        write_dossier(CORRIDOR, run, **given)
    assert says in str(error.value)
    assert not (run / "dossier").exists()


def test_what_is_named_must_be_there(problem: CalibrationProblem, tmp_path: Path):
    run = run_with(tmp_path / "run", result=result_of(problem))
    with pytest.raises(CaseError, match=r"diagnosis\.json: expected this file"):
        write_dossier(CORRIDOR, run, diagnosis_run=tmp_path)


def test_the_command_says_what_is_missing(
    problem: CalibrationProblem, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    run = run_with(tmp_path / "run", result=result_of(problem))
    assert app(["dossier", str(CORRIDOR), str(run)], result_action="return_value") == 0
    said = capsys.readouterr().out
    assert f"Purpose and scope of use: {len(ASKED_OF_PEOPLE)} missing" in said
    assert "dossier.html" in said


@pytest.mark.parametrize(
    ("name", "changed", "says"),
    [
        ("validation", {"case": "another motorway"}, 'validation.json: case: expected a validation of "corridor"'),
        ("validation", {"parameters": {"main": 1.0}}, "validation.json: parameters: expected the values of RUN"),
        ("diagnosis", None, 'expected a diagnosis of "corridor", got one of "another motorway"'),
    ],
)
def test_evidence_of_another_case_is_refused(
    problem: CalibrationProblem, tmp_path: Path, name: str, changed: dict[str, Any] | None, says: str
):
    content = (validation_of(problem) if name == "validation" else DIAGNOSIS) | (changed or {})
    run = run_with(tmp_path / "run", result=result_of(problem), **{name: content})
    (run / "run.json").write_text(json.dumps({"case": "corridor 12ab", "options": "{}", "program": "3"}))
    (run / name / "run.json").write_text(json.dumps({"case": "another motorway 12ab"}))
    with pytest.raises(CaseError) as error:
        write_dossier(CORRIDOR, run)
    assert says in str(error.value)


def test_a_validation_of_other_files_and_its_warnings_are_told(problem: CalibrationProblem, tmp_path: Path):
    found = validation_of(problem)
    none = dict.fromkeys(("mild", "medium", "severe"), 0.0)
    many = {"mild": 20.0, "medium": 3.0, "severe": 1.0}
    found["encounters"]["cut_in"] |= {"field": many, "simulated": none, "f1": 0.0, "limit": None}
    found["encounters"]["all"]["limit"] = None
    found["warnings"] = ["Drives that did not reach their destination before their run ended: 33 in 40 runs."]
    run = run_with(tmp_path / "run", result=result_of(problem), validation=found)
    (run / "run.json").write_text(json.dumps({"case": "corridor 12ab", "options": "{}", "program": "3"}))
    (run / "validation/run.json").write_text(json.dumps({"case": "corridor 34cd"}))
    write_dossier(CORRIDOR, run)
    text = (run / "dossier/dossier.json").read_text()
    assert "The validation saw other files of the case than the calibration." in text
    assert "33 in 40 runs" in text
    assert "The field has 24 encounters of the kind cut in, the simulation none." in text
    assert "fewer than 19 rounds" in text


def test_a_round_alone_says_nothing_of_scatter_and_half_a_step_of_its_error(
    problem: CalibrationProblem, tmp_path: Path
):
    result = result_of(problem)
    result["per_seed"]["calibrated"]["held_out"] = dict(result["moes"]["calibrated"]["held_out"])
    one = {"half_step": 20.0, "step": 21.0, "difference": 0.05, "interval_90": [0.04, 0.06], "margin": 0.15}
    quantities = {
        "speed_mps": one | {"verdict": "equivalent"},
        "gap_m": one | {"verdict": "different"},
        "volume_vehph": one | {"verdict": "not enough rounds"},
    }
    found = validation_of(problem) | {"step_error": {"half_step_s": 0.05, "step_s": 0.1, "quantities": quantities}}
    run = run_with(tmp_path, result=result, validation=found)
    dossier = write_dossier(CORRIDOR, run)
    missing = missing_of(dossier, "Numerical")
    assert "Scatter of single rounds on the held-out drives: only one round was run." in missing
    assert "--half-step" not in missing
    assert "leaves volume_vehph the same" in missing
    assert "speed_mps" not in missing
    (section,) = [section for section in dossier.sections if section.heading == "Numerical error"]
    assert "gap_m differs by 5.0 % from that with half the step." in section.failures
    titles = [table.title for table in section.tables]
    assert "Half the step" in titles
    assert not any("single runs" in title for title in titles)


def test_a_case_below_a_hidden_folder_is_hashed_all_the_same_and_hidden_files_of_its_own_are_not(
    problem: CalibrationProblem, tmp_path: Path
):
    case = tmp_path / ".work" / "case"
    shutil.copytree(CORRIDOR, case)
    (case / ".note").write_text("nobody's")
    (case / "check.html").write_text("a check's")
    run = run_with(tmp_path / ".work" / "run", result=result_of(problem))
    (table,) = [t for t in write_dossier(case, run).sections[-1].tables if t.title == "Files"]
    names = [row[0] for row in table.rows]
    assert {"CASE/case.toml", "CASE/scenario/net.net.xml", "RUN/result.json"} <= set(names)
    assert not {"CASE/.note", "CASE/check.html"} & set(names)


@pytest.mark.parametrize("verdict", ["miscalibrated", "no_gap", "not_testable"])
def test_only_what_is_missing_speaks_against_the_calibrated_simulation(
    problem: CalibrationProblem, tmp_path: Path, verdict: str
):
    found = DIAGNOSIS | {"verdict": verdict, "effects": []}
    run = run_with(tmp_path, result=result_of(problem), diagnosis=found)
    (section,) = [one for one in write_dossier(CORRIDOR, run).sections if one.heading.startswith("The gap")]
    assert section.failures == []


def test_a_search_that_sumo_made_is_told_as_one(problem: CalibrationProblem, tmp_path: Path):
    result = result_of(problem)
    result["confirmation"]["searched_in_sumo"] = True
    dossier = write_dossier(CORRIDOR, run_with(tmp_path, result=result))
    titles = [table.title for section in dossier.sections for table in section.tables]
    assert "Parameters; intervals by logs and SUMO" in titles
    assert any(title.startswith("Sensitivity in stage1") and title.endswith("in SUMO") for title in titles)
    assert missing_of(dossier, "Model") == ""


def test_a_search_that_went_on_with_sumo_is_told_as_one(problem: CalibrationProblem, tmp_path: Path):
    result = result_of(problem)
    result["confirmation"]["went_on_by"] = ["space mapping", "search in SUMO"]
    result["confirmation"]["agreement"][0]["where"] = "at the values found with SUMO"
    said = write_dossier(CORRIDOR, run_with(tmp_path, result=result)).to_json()
    assert "Values were searched in the surrogate, then by space mapping, then by search in SUMO; errors" in said
    assert "At the values found with SUMO: in 40% of the sections" in said
