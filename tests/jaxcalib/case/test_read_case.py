"""case.toml is read into records, and whatever is wrong with it is said in one line."""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from jaxcalib.case.case import Perception, read_case, require_scenario
from jaxcalib.case.safety_limits import USUAL_LIMITS
from jaxcalib.errors import LONGEST_MESSAGE, CaseError


def spoil(folder: Path, old: str, new: str, count: int = 1) -> None:
    file = folder / "case.toml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, count))


def message(folder: Path) -> str:
    with pytest.raises(CaseError) as error:
        read_case(folder)
    line = str(error.value)
    assert len(line) <= LONGEST_MESSAGE
    assert line.isprintable()
    return line


def test_reads_everything(case_folder: Path):
    case = read_case(case_folder)
    assert case.name == "small"
    assert case.perception == Perception(150.0, 120.0, 4.8)
    assert case.scenario is not None
    assert case.scenario.config_file == case_folder / "scenario/scenario.sumocfg"
    assert (case.scenario.warmup_s, case.scenario.duration_s, case.scenario.step_s) == (60.0, 300.0, 0.1)
    assert case.subject is not None
    assert (case.subject.vtype, case.subject.vehicle) == ("subject", "ego")
    assert case.behaviour is not None
    assert case.behaviour.vtypes == ("car",)
    assert case.behaviour.parameters == ("tau", "minGap")
    assert [entrance.flows for entrance in case.inputs] == [("f_main_o1", "f_main_e"), ("f_on1",)]
    assert [drive.id for drive in case.drives] == ["d01", "d02"]
    assert [drive.id for drive in case.drives_of("held_out")] == ["d02"]
    assert case.drives[0].subject_file == case_folder / "field/d01_subject.csv"
    assert case.drives[1].depart_s == 80.0


def test_reads_a_file_with_byte_order_mark(case_folder: Path):
    text = (case_folder / "case.toml").read_bytes()
    (case_folder / "case.toml").write_bytes(b"\xef\xbb\xbf" + text)
    assert read_case(case_folder).name == "small"


def test_parameters_may_be_left_out(case_folder: Path):
    spoil(case_folder, 'parameters = ["tau", "minGap"]\n', "")
    behaviour = read_case(case_folder).behaviour
    assert behaviour is not None
    assert behaviour.parameters is None


def test_limits_of_safety_measures_may_be_stated_one_by_one(case_folder: Path):
    assert read_case(case_folder).safety == USUAL_LIMITS
    file = case_folder / "case.toml"
    file.write_text(file.read_text().replace("[behaviour]", "[safety]\nttc_s = 2.5\n\n[behaviour]"))
    assert read_case(case_folder).safety == USUAL_LIMITS._replace(ttc_s=2.5)


def test_the_scenario_may_be_left_out_until_something_needs_it(case_folder: Path):
    text = (case_folder / "case.toml").read_text()
    perception = text[text.index("[perception]") : text.index("[behaviour]")]
    drives = text[text.index("[[drive]]") :]
    (case_folder / "case.toml").write_text(f'format = 1\nname = "logs only"\n{perception}{drives}')
    case = read_case(case_folder)
    assert case.scenario is None
    assert case.subject is None
    assert case.behaviour is None
    assert case.inputs == ()
    with pytest.raises(CaseError) as error:
        require_scenario(case)
    assert str(error.value) == (
        "case.toml: [scenario], [subject], [behaviour]: expected for everything that runs the scenario; missing here."
    )


def test_require_scenario_names_only_what_is_missing(case_folder: Path):
    assert require_scenario(read_case(case_folder)).scenario.step_s == 0.1
    text = (case_folder / "case.toml").read_text()
    begin, end = text.index("[[input]]"), text.index("[[drive]]")
    (case_folder / "case.toml").write_text(text[:begin] + text[end:])
    assert require_scenario(read_case(case_folder)).inputs == ()  # entrances are found in the scenario
    begin, end = text.index("[behaviour]"), text.index("[[input]]")
    (case_folder / "case.toml").write_text(text[:begin] + text[end:])
    with pytest.raises(CaseError, match=r"^case.toml: \[behaviour\]: expected"):
        require_scenario(read_case(case_folder))


LENGTH = "expected a number > 0 and at most 100000"
VEHICLE_LENGTH = "expected a vehicle's length in m, a number > 0 and at most 30"
NAME = "text of 1 to 200 characters, none of them a control character"
STEM = "text of 1 to 200 characters without / and \\, not beginning with a dot"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("ahead_m   = 150.0", 'ahead_m = "far"', f'perception.ahead_m: {LENGTH}, got "far".'),
        ("ahead_m   = 150.0", "ahead_m = true", f"perception.ahead_m: {LENGTH}, got true."),
        ("ahead_m   = 150.0", "ahead_m = -1", f"perception.ahead_m: {LENGTH}, got -1."),
        ("behind_m  = 120.0", "behind_m = 0", f"perception.behind_m: {LENGTH}, got 0."),
        ("behind_m  = 120.0", "behind_m = inf", f"perception.behind_m: {LENGTH}, got inf."),
        ("4.8", "nan", f"perception.nominal_length_m: {VEHICLE_LENGTH}, got nan."),
        ("4.8", "0.0", f"perception.nominal_length_m: {VEHICLE_LENGTH}, got 0.0."),
        ("4.8", "4800.0", f"perception.nominal_length_m: {VEHICLE_LENGTH}, got 4800.0."),
        ('"front"', '"centre"', 'perception.reference: expected "front" (front bumper to front bumper), got "centre".'),
        ("ahead_m ", "ahed_m ", 'perception.ahed_m: expected no such key; did you mean "ahead_m"?'),
        ("ahead_m   = 150.0\n", "", f"perception.ahead_m: {LENGTH}; missing."),
        (
            "[subject]\n",
            "[subject]\nzzz = 1\n",
            "subject.zzz: expected no such key; the keys here are vtype, vehicle, model, parameters.",
        ),
        ('"ego"', '"ego"\nmodel = 3', f"subject.model: expected {NAME}, got 3."),
        (
            '"ego"',
            '"ego"\n[subject.parameters]\ntime_gap_s = "long"',
            "subject.parameters: expected a table of numbers by name, got a table.",
        ),
        ("[behaviour]", "[behavior]", 'behavior: expected no such key; did you mean "behaviour"?'),
        ("[behaviour]", "[[behaviour]]", "behaviour: expected a table [behaviour], got a list."),
        ("format = 1", "format = 2", "format: expected 1, the format that this version reads, got 2."),
        ("format = 1\n", "", "format: expected 1, the format that this version reads; missing."),
        ('name = "small"', "name = 3", f"name: expected {NAME}, got 3."),
        ('name = "small"', 'name = ""', f'name: expected {NAME}, got "".'),
        ('name = "small"', 'name = "a\\u0007b"', f'name: expected {NAME}, got "ab".'),
        ("step_s     = 0.1", "step_s = 0", "scenario.step_s: expected a number > 0 and at most 10, got 0."),
        ("duration_s = 300", "duration_s = -5", "scenario.duration_s: expected a number > 0 and at most 1e7, got -5."),
        ("warmup_s   = 60.0", "warmup_s = -1", "scenario.warmup_s: expected a number >= 0 and at most 1e7, got -1."),
        ("warmup_s   = 60.0", "warmup_s = 300", "scenario.warmup_s: expected less than duration_s (300), got 300."),
        (
            "depart_s = 80.0",
            "depart_s = 300.5",
            "drive[d02].depart_s: expected 0 to scenario.duration_s (300), got 300.5.",
        ),
        ("depart_s = 80.0", "depart_s = -1", "drive[d02].depart_s: expected a number >= 0 and at most 1e7, got -1."),
        ('"held_out"', '"test"', 'drive[d02].role: expected "fit" or "held_out", got "test".'),
        ('"fit"', '"held_out"', 'drive: expected at least one drive with role "fit"; all are "held_out".'),
        ('id       = "d02"', 'id = "d01"', 'drive[2].id: expected a new id, got "d01" again.'),
        ('id       = "d02"', "id = 2", f"drive[2].id: expected {STEM}, got 2."),
        ('id       = "d02"', 'id = "../../x"', f'drive[../../x].id: expected {STEM}, got "../../x".'),
        ('id    = "on1"', 'id = "main"', 'input[2].id: expected a new id, got "main" again.'),
        (
            '"f_on1"',
            '"f_main_e"',
            'input[on1].flows: expected each flow once, got "f_main_e", which input "main" has too.',
        ),
        ('["f_on1"]', "[]", "input[on1].flows: expected a list of at least one name, got an empty list."),
        ('["f_on1"]', '"f_on1"', 'input[on1].flows: expected a list of at least one name, got "f_on1".'),
        ('["f_on1"]', "[1]", f"input[on1].flows[1]: expected {NAME}, got 1."),
        ('["car"]', '["car", "car"]', 'behaviour.vtypes: expected each name once, got "car" again.'),
        ('"IDM"', "1.5", f"behaviour.car_following: expected {NAME}, got 1.5."),
        (
            '"field/d02_objects.csv"',
            '"field/none.csv"',
            'drive[d02].objects: expected an existing file, got "field/none.csv".',
        ),
        ('"field/d02_objects.csv"', '"field"', 'drive[d02].objects: expected an existing file, got "field".'),
        (
            '"field/d01_subject.csv"',
            '"../other/x.csv"',
            'drive[d01].subject: expected an existing file, got "../other/x.csv".',
        ),
        (
            '"scenario/scenario.sumocfg"',
            '"/no/such.sumocfg"',
            'scenario.config: expected an existing file, got "/no/such.sumocfg".',
        ),
        (
            '"field/d01_subject.csv"',
            '"field/\\u0000.csv"',
            'drive[d01].subject: expected an existing file, got "field/.csv".',
        ),
        (
            "[subject]",
            "[subject",
            "expected TOML: Expected ']' at the end of a table declaration (at line 10, column 9).",
        ),
        ("format = 1", "format = 1\nformat = 1", "expected TOML: Cannot overwrite a value (at line 2, column 11)."),
        ("format = 1", "x = " + "[" * 4000, "expected fewer levels of tables and lists in one another."),
        ("format = 1", "a" + ".a" * 21 + " = 1", "line 1: expected at most 20 dots outside of quotes."),
        ("format = 1", "#" * 65_536, "expected at most 64 KiB."),
    ],
)
def test_says_what_is_wrong(case_folder: Path, old: str, new: str, expected: str):
    spoil(case_folder, old, new)
    assert message(case_folder) == f"case.toml: {expected}"


def all_messages(folder: Path) -> list[str]:
    with pytest.raises(CaseError) as error:
        read_case(folder)
    return [str(fault).removeprefix("case.toml: ") for fault in (error.value, *error.value.others)]


def test_all_wrong_keys_are_named_at_once(case_folder: Path):
    for old, new in (
        ("warmup_s   = 60.0", 'warmup_s   = "60"'),
        ("step_s     = 0.1", "step_s     = -0.1\nstep_length = 0.1"),
        ('vehicle      = "ego"\n', ""),
        ('flows = ["f_on1"]', "flows = []"),
        ('role     = "fit"', 'role     = "test"'),
    ):
        spoil(case_folder, old, new)
    assert all_messages(case_folder) == [
        "scenario.step_length: expected no such key; the keys here are config, warmup_s, duration_s, step_s.",
        'scenario.warmup_s: expected a number >= 0 and at most 1e7, got "60".',
        "scenario.step_s: expected a number > 0 and at most 10, got -0.1.",
        "subject.vehicle: expected text of 1 to 200 characters, none of them a control character; missing.",
        "input[on1].flows: expected a list of at least one name, got an empty list.",
        'drive[d01].role: expected "fit" or "held_out", got "test".',
    ]


def test_all_that_does_not_fit_together_is_named_at_once(case_folder: Path):
    spoil(case_folder, "warmup_s   = 60.0", "warmup_s   = 400.0")
    spoil(case_folder, 'flows = ["f_on1"]', 'flows = ["f_main_e"]')
    for name in ("d01_subject", "d02_objects"):
        spoil(case_folder, f"field/{name}.csv", f"field/no_{name}.csv")
    assert all_messages(case_folder) == [
        'input[on1].flows: expected each flow once, got "f_main_e", which input "main" has too.',
        "scenario.warmup_s: expected less than duration_s (300), got 400.",
        'drive[d01].subject: expected an existing file, got "field/no_d01_subject.csv".',
        'drive[d02].objects: expected an existing file, got "field/no_d02_objects.csv".',
    ]


def test_refuses_a_case_without_drives(case_folder: Path):
    text = (case_folder / "case.toml").read_text()
    (case_folder / "case.toml").write_text(text[: text.index("[[drive]]")])
    assert message(case_folder) == "case.toml: drive: expected at least one [[drive]], got none."


def test_refuses_text_that_is_not_utf8(case_folder: Path):
    (case_folder / "case.toml").write_bytes(b'format = 1\nname = "\xe4"\n')
    assert message(case_folder) == "case.toml: line 2: expected UTF-8 text."


def test_names_a_missing_case_file(tmp_path: Path):
    assert message(tmp_path / "none").startswith('case.toml: expected this file in the folder "')


@pytest.mark.parametrize("is_absolute", [True, False])
def test_files_may_lie_outside_of_the_folder(case_folder: Path, tmp_path: Path, is_absolute: bool):
    elsewhere = tmp_path / "logs" / "objects.csv"
    elsewhere.parent.mkdir()
    (case_folder / "field/d01_objects.csv").rename(elsewhere)
    path = str(elsewhere) if is_absolute else "../logs/objects.csv"
    spoil(case_folder, '"field/d01_objects.csv"', f'"{path}"')
    assert read_case(case_folder).drives[0].objects_file.resolve() == elsewhere.resolve()


def test_accepts_a_link_inside_the_folder_and_a_linked_folder(case_folder: Path, tmp_path: Path):
    (case_folder / "field/d01_objects.csv").unlink()
    (case_folder / "field/d01_objects.csv").symlink_to(case_folder / "field/d02_objects.csv")
    (tmp_path / "link").symlink_to(case_folder)
    assert read_case(tmp_path / "link").folder == case_folder.resolve()


def test_refuses_links_in_a_circle(case_folder: Path):
    (case_folder / "field/d01_objects.csv").unlink()
    (case_folder / "field/d01_objects.csv").symlink_to("d01_objects.csv")
    assert message(case_folder).startswith("case.toml: drive[d01].objects: expected ")


def test_refuses_a_pipe(case_folder: Path):
    (case_folder / "field/d01_objects.csv").unlink()
    os.mkfifo(case_folder / "field/d01_objects.csv")
    assert message(case_folder).startswith("case.toml: drive[d01].objects: expected an existing file")


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_change_reads_or_fails_in_one_line(case_folder: Path, data: st.DataObject):
    """Random damage never ends in anything but a case or a CaseError."""
    file = case_folder / "case.toml"
    original = file.read_text()
    begin = data.draw(st.integers(0, len(original)))
    end = data.draw(st.integers(begin, min(begin + 40, len(original))))
    damaged = original[:begin] + data.draw(st.text(max_size=20)) + original[end:]
    file.write_bytes(damaged.encode("utf-8", "surrogatepass"))
    line = "case"
    try:
        read_case(case_folder)
    except CaseError as error:
        line = str(error)
    finally:
        file.write_text(original)
    assert len(line) <= LONGEST_MESSAGE
    assert line.isprintable()


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        ('model = "plan"', "subject.model: expected a known name: there is no subject model 'plan'; known are vtype, "),
        (
            'model = "planner"\n[subject.parameters]\nsafty_weight = 1',
            "subject.parameters: expected a known name: planner has no parameter 'safty_weight'; it has safety_w",
        ),
        (
            'model = "planner"\n[subject.parameters]\nyield_deceleration_mps2 = 9.0',
            "subject.parameters: expected a value within its range: planner: yield_deceleration_mps2 is 9; expected",
        ),
        (
            'model = "aovrv"\n[subject.parameters]\nsafety_weight = 1.0',
            "subject.parameters: expected a known name: aovrv has no parameter 'safety_weight'; it has jam_gap_m, ",
        ),
        ('model = "replay"\nparameters = {x = 1.0}', "subject.parameters: expected a known name: replay has no param"),
    ],
)
def test_a_driver_that_does_not_exist_is_refused(case_folder: Path, model: str, expected: str):
    file = case_folder / "case.toml"
    file.write_text(file.read_text().replace('"ego"\n', f'"ego"\n{model}\n'))
    with pytest.raises(CaseError) as error:
        read_case(case_folder)
    assert str(error.value).startswith(f"case.toml: {expected}")


def test_the_driver_of_the_subject_vehicle_is_its_vtype_unless_named(case_folder: Path):
    subject = read_case(case_folder).subject
    assert subject is not None
    assert subject.model.name == "vtype"
    file = case_folder / "case.toml"
    file.write_text(
        file.read_text().replace('"ego"\n', '"ego"\nmodel = "planner"\nparameters = {comfort_weight = 2}\n')
    )
    subject = read_case(case_folder).subject
    assert subject is not None
    assert (subject.model.name, dict(subject.model.parameters)) == ("planner", {"comfort_weight": 2.0})
