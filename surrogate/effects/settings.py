"""The settings of all effects in one run, as leaves."""

from collections.abc import Mapping

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from surrogate.effects.base import Dial, EffectSetting
from surrogate.effects.registry import EFFECT_NUMBER, EFFECTS, effect_named

EVERYWHERE_M = 1e9
ALWAYS_S = 1e9


class Effects(eqx.Module):
    """The settings of all effects in one run."""

    values: Float[Array, "*run effect field"]  # one row per effect of the registry, one column per field of `Dial`

    def dial(self, name: str) -> Dial:
        """The setting of one effect."""
        row = self.values[EFFECT_NUMBER[name]]
        return Dial(*(row[column] for column in range(len(Dial.FIELDS))))


def settings_table(settings: Mapping[str, EffectSetting]) -> np.ndarray:
    """The settings as the array that `Effects` holds, [effect, field].

    Raises:
        UnknownEffectError: a name is no effect's.
    """
    for name in settings:
        effect_named(name)
    rows = []
    for effect in EFFECTS:
        setting = settings.get(effect.name, EffectSetting(0.0))
        given = (
            (setting.route_from_m, -EVERYWHERE_M),
            (setting.route_to_m, EVERYWHERE_M),
            (setting.time_from_s, -ALWAYS_S),
            (setting.time_to_s, ALWAYS_S),
            (setting.choice, effect.default_choice),
            (setting.time_constant_s, effect.default_time_constant_s),
        )
        rows.append([setting.strength, *(usual if value is None else value for value, usual in given)])
    return np.asarray(rows, np.float32)
