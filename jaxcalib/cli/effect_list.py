"""The library of effects, as `jaxcalib effects` prints it."""

from rich.console import Console
from rich.padding import Padding
from rich.text import Text

from surrogate.effects.base import Effect
from surrogate.effects.registry import EFFECTS

INDENT = (0, 0, 0, 4)


def reported(effect: Effect, strength: float) -> str:
    """Return a strength as people name it."""
    return f"{effect.reported_at_zero + strength:g}"


def dials(effect: Effect) -> str:
    """Return what else than the strength can be set."""
    parts = ["place"] * effect.has_place + ["time"] * effect.has_time
    parts += [effect.choice] * bool(effect.choice) + [effect.time_constant] * bool(effect.time_constant)
    return "; ".join(parts)


def print_effects(console: Console | None = None) -> None:
    """Print every effect: what it is, where it acts, its unit, its range of strength and its source."""
    console = console or Console()
    console.print(f"{len(EFFECTS)} effects that a simulation may lack; strengths are weak / medium / strong\n")
    for effect in EFFECTS:
        strengths = " / ".join(reported(effect, value) for value in (effect.weak, effect.medium, effect.strong))
        sign = ", either sign" * effect.is_signed
        console.print(Text.assemble((effect.name, "bold"), f"  acts on {effect.acts_on.value}  {strengths}{sign}"))
        lines = [effect.title, f"strength: {effect.unit}"]
        lines += [f"also: {dials(effect)}"] * bool(dials(effect)) + [f"source: {effect.source}"]
        for line in lines:
            console.print(Padding(Text(line), INDENT))
        console.print()
