"""Where and when an effect acts that is not everywhere."""

from dataclasses import dataclass

from jaxcalib.diagnosis.features.signature import Signature
from surrogate.effects.base import EffectSetting
from surrogate.effects.registry import effect_named


@dataclass(frozen=True)
class Window:
    """A place and time at which a local effect may be."""

    from_m: float  # begin, as positions on the route
    to_m: float  # end
    from_s: float | None = None  # begin of the time; None for always
    to_s: float | None = None  # its end
    lane: int | None = None  # counted from the left; None for all
    sign: float = 1.0  # 1 where vehicles lose speed there, -1 where they gain

    def setting(self) -> dict[str, float]:
        """Return it for people and files."""
        setting: dict[str, float] = {"route_from_m": self.from_m, "route_to_m": self.to_m}
        if self.from_s is not None and self.to_s is not None:
            setting |= {"time_from_s": self.from_s, "time_to_s": self.to_s}
        if self.lane is not None:
            setting["lane_from_left"] = float(self.lane)
        return setting

    def effect_setting(self, strength: float) -> EffectSetting:
        """The setting of an effect here, as a simulator takes it."""
        return EffectSetting(
            strength,
            route_from_m=self.from_m,
            route_to_m=self.to_m,
            time_from_s=self.from_s,
            time_to_s=self.to_s,
            choice=None if self.lane is None else float(self.lane),
        )


def window_of(signature: Signature) -> Window | None:
    """Place and time of a signature's effect; None for everywhere."""
    at = signature.setting
    if "route_from_m" not in at:
        return None
    lane = at.get("lane_from_left")
    return Window(
        at["route_from_m"],
        at["route_to_m"],
        at.get("time_from_s"),
        at.get("time_to_s"),
        None if lane is None else int(lane),
        effect_named(signature.effect).slows * signature.sign,
    )
