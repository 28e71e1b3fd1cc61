"""All effects, in the order in which results list them. To add one: write its file and enter it here."""

from surrogate.effects.base import Effect
from surrogate.effects.gap_sensor_bias import GAP_SENSOR_BIAS
from surrogate.effects.grade import GRADE
from surrogate.effects.reaction_delay import REACTION_DELAY

EFFECTS: tuple[Effect, ...] = (
    REACTION_DELAY,
    GRADE,
    GAP_SENSOR_BIAS,
)
EFFECT_NAMES = tuple(effect.name for effect in EFFECTS)
EFFECT_NUMBER = {name: number for number, name in enumerate(EFFECT_NAMES)}


class UnknownEffectError(ValueError):
    """A name that no effect has."""

    def __init__(self, name: str) -> None:
        """List the known ones."""
        super().__init__(f"unknown effect '{name}'; known are {', '.join(EFFECT_NAMES)}")


def effect_named(name: str) -> Effect:
    """Return an effect.

    Raises:
        UnknownEffectError: there is none of that name.
    """
    if name not in EFFECT_NUMBER:
        raise UnknownEffectError(name)
    return EFFECTS[EFFECT_NUMBER[name]]
