"""`jaxcalib effects` lists the library."""

import pytest

from jaxcalib.cli.app import effects
from surrogate.effects.registry import EFFECTS


def test_every_effect_is_listed_with_unit_range_place_and_source(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    assert effects() == 0
    shown = capsys.readouterr().out
    for effect in EFFECTS:
        assert f"{effect.name}  acts on {effect.acts_on.value}" in shown
        assert effect.unit in shown
        assert effect.source in shown
    assert "memory  acts on decision  1.2 / 1.5 / 1.8" in shown  # a factor counts from 1
