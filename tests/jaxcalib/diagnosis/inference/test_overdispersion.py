"""How sure evidence may be, and that no single feature outvotes all others."""

from dataclasses import replace

import numpy as np
import pytest

from jaxcalib.diagnosis.inference import marginal_likelihood
from jaxcalib.diagnosis.inference.marginal_likelihood import (
    KNEE,
    Explained,
    explain,
    squeezed,
)
from jaxcalib.diagnosis.inference.overdispersion import LEAST_TEMPERATURE, temperature
from tests.jaxcalib.diagnosis.inference.test_inference import NULL, SIGNATURES, noise


@pytest.mark.parametrize("difference", [0.01, -0.3, 2.0, -50.0])
def test_small_differences_count_as_they_are_and_large_ones_by_their_logarithm(difference: float):
    told, exact = squeezed(np.full(2, difference), np.asarray([KNEE, np.inf]))
    assert exact == difference
    assert told == pytest.approx(KNEE * np.log(difference / KNEE + np.hypot(1.0, difference / KNEE)), rel=1e-9)
    assert told == pytest.approx(-squeezed(np.full(1, -difference), np.full(1, KNEE))[0])
    assert abs(told - difference) <= abs(difference) ** 3 / (6.0 * KNEE**2)  # the series' next term bounds the rest


def test_one_feature_far_off_does_not_outvote_the_others(monkeypatch: pytest.MonkeyPatch):
    """A feature in which another effect shows most stands far off; as it is, it would decide."""
    wrong = SIGNATURES["keep_right"].shift[1]
    feature = int(np.argmax(np.abs(wrong) - np.abs(SIGNATURES["memory"].shift[1])))
    field = noise(4) + 1.5 * SIGNATURES["memory"].shift[1]
    field[feature] += 60.0 * np.sign(wrong[feature])

    def best() -> str:
        found = {name: explain(field, NULL, [one], 1.0).log_evidence for name, one in SIGNATURES.items()}
        return max(found, key=found.__getitem__)

    assert best() == "memory"
    monkeypatch.setattr(marginal_likelihood, "KNEE", 1e6)
    assert best() == "keep_right"


def test_what_is_expected_of_an_effect_is_told_in_units_of_noise():
    strong = replace(SIGNATURES["grade"], shift=20.0 * SIGNATURES["grade"].shift)
    field = strong.shift[1]
    told = explain(field, NULL, [strong], 1.0)
    assert told.shift is not None
    assert np.linalg.norm(told.shift) == pytest.approx(told.strength * np.linalg.norm(strong.shift[1]), rel=0.05)


def test_evidence_is_as_sure_as_its_best_explanation_fits():
    by_chance = 230.0
    none = Explained("none", 0.0, best_misfit=900.0)
    fits, fits_not = (Explained("memory", 9.0, best_misfit=share * by_chance) for share in (0.8, 6.0))
    ramp = Explained("ramp_inflow_error", 20.0)  # has no misfit of its own
    assert temperature([ramp, fits, none], by_chance) == LEAST_TEMPERATURE
    assert temperature([ramp, fits_not, fits, none], by_chance) == pytest.approx(6.0 * LEAST_TEMPERATURE)
    assert temperature([none], by_chance) == LEAST_TEMPERATURE
