"""What a diagnosis tells its reader to be careful of."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from jaxcalib.diagnosis.answer.findings import Findings
from jaxcalib.diagnosis.answer.remarks import not_testable, warnings_of
from jaxcalib.diagnosis.inference.marginal_likelihood import Explained
from sim_adapters.interface import ParameterLayout
from surrogate.effects.registry import EFFECTS
from tests.jaxcalib.diagnosis.synthetic import one_feature_each

NAMES = ("main", "tau", "lcSpeedGain")
NULL = one_feature_each(NAMES)


def findings(
    num_drives: int = 8,
    departs_s: Sequence[float] = (300.0, 320.0),
    steps: Sequence[float] = (0.0, 0.0, 0.0),
    moved: Sequence[str] = (),
    instead_of: str = "",
    held_out: Any = "some",
    num_held_out: int = 1,
) -> Findings:
    drives = [SimpleNamespace(depart_s=depart_s, role="fit") for depart_s in departs_s]
    drives += [SimpleNamespace(depart_s=900.0, role="held_out")] * num_held_out
    problem = SimpleNamespace(warnings=list, layout=SimpleNamespace(names=NAMES), case=SimpleNamespace(drives=drives))
    fitted = SimpleNamespace(tallies=range(num_drives), difference=np.asarray(steps), null=NULL)
    return cast(
        Findings, SimpleNamespace(problem=problem, fitted=fitted, moved=moved, instead_of=instead_of, held_out=held_out)
    )


def test_usual_drives_need_no_warning():
    assert warnings_of(findings()) == []


@pytest.mark.parametrize(
    ("some", "words"),
    [
        (findings(num_drives=2), "2 drives to fit"),
        (findings(departs_s=(300.0, 300.0)), "all drives to fit depart at the same time"),
        (findings(steps=(0.5, -4.0, 1.0)), "tau: the features would move them farther"),
        (findings(moved=("lcSpeedGain", "lcStrategic")), "lcSpeedGain, lcStrategic: no log shows them by itself"),
        (
            findings(moved=("lcSpeedGain",), instead_of="lane_change_relaxation"),
            "Where they were, the best explanation was: lane change relaxation.",
        ),
        (findings(held_out=None, num_held_out=0), "no drive is held out"),
        (findings(held_out=None), "too little is seen of the drives that are held out"),
    ],
)
def test_each_trouble_has_a_line(some: Findings, words: str):
    (line,) = warnings_of(some)
    assert words in line


def test_an_effect_that_is_a_calibrated_value_is_named_as_that():
    layout = ParameterLayout((), (), ("car",), ("tau", "lcKeepRight"))
    problem = SimpleNamespace(layout=layout)
    explained = [Explained(effect.name, 0.0) for effect in EFFECTS if effect.name not in ("keep_right", "memory")]
    reasons = not_testable(cast(Findings, SimpleNamespace(problem=problem, explained=explained)))
    assert reasons["keep_right"] == "lcKeepRight, calibrated, is all that it is: what differs is a value"
    assert set(reasons) == {"keep_right", "memory"}
