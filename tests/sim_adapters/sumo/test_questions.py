"""A process that is asked may answer anything, or nothing: it is an answer of the form asked for, or none."""

import time
from typing import Any, TypedDict

import pytest

from sim_adapters.sumo.question import start_worker

MODULE = "tests.sim_adapters.sumo.odd_answers"


class Form(TypedDict):
    """What is asked for."""

    edge: str
    waiting: list[str]


def ask(question: dict[str, Any], longest_s: float = 60.0) -> tuple[Form | None, list[str]]:
    return start_worker(MODULE, question, longest_s, Form)()


def test_an_answer_of_its_form_is_an_answer_whatever_else_is_printed():
    said, lines = ask({"says": '{"edge": "m3", "waiting": ["f.1"]}'})
    assert said == {"edge": "m3", "waiting": ["f.1"]}
    assert "is no UTF-8" in lines[0]


@pytest.mark.parametrize("says", ["{not JSON", "5", "[1, 2]", '{"edge": "m3"}', '{"edge": "m3", "waiting": [7]}'])
def test_an_answer_of_another_form_is_none(says: str):
    said, lines = ask({"says": says})
    assert said is None
    assert lines == ["its process gave no answer that can be read"]


def test_who_says_nothing_has_no_answer_and_who_hangs_is_ended():
    assert ask({})[0] is None
    began_s = time.monotonic()
    said, lines = ask({"hangs_s": 50.0}, longest_s=2.0)
    assert said is None
    assert lines == ["it came to no end within 2 s"]
    assert time.monotonic() - began_s < 30.0
