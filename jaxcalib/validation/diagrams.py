"""The fundamental diagrams of a validation: volume over density of each section, field beside simulation."""

import itertools

from matplotlib.axes import Axes

from jaxcalib.html.drawing import AFTER, FIELD, svg_grid
from jaxcalib.measures.fundamental_diagram import LEVELS
from jaxcalib.validation.result import ValidationResult
from sim_adapters.units import kmh_from_mps

Points = list[tuple[float, float]]
SIDES = {"field": (FIELD, "o-"), "simulated": (AFTER, "s--")}
COLUMNS = 4
FEWEST_POINTS = 2


def diagrams_figure(result: ValidationResult) -> str:
    """Return the diagrams of the sections that the field shows at two levels of service or more; empty without any."""
    sections = {
        section: sides
        for section, sides in diagrams_of(result).items()
        if len(sides["field"]) >= FEWEST_POINTS
    }  # fmt: skip
    if not sections:
        return ""
    num_rows = -(-len(sections) // COLUMNS)

    def draw(axes: list[list[Axes]]) -> None:
        boxes = list(itertools.chain(*axes))
        for box, (section, sides) in zip(boxes, sections.items(), strict=False):
            for side, (color, style) in SIDES.items():
                densities, volumes = ([point[k] for point in sides[side]] for k in range(2))
                box.plot(densities, volumes, style, color=color, ms=3.5, lw=1.0, label=side, clip_on=False)
            box.set_title(f"section {section}", fontsize=8)
            box.set_xlim(left=0.0)
            box.set_ylim(bottom=0.0)
            box.tick_params(labelsize=6)
        boxes[0].set_xlabel("veh/km and lane", fontsize=7)
        boxes[0].set_ylabel("veh/h and lane", fontsize=7)
        boxes[0].legend(frameon=False, fontsize=7)
        for box in boxes[len(sections) :]:
            box.set_axis_off()

    return svg_grid(draw, num_rows, COLUMNS, 7.6, 1.7 * num_rows + 0.3)


def diagrams_of(result: ValidationResult) -> dict[int, dict[str, Points]]:
    """Return density in veh/km and volume in veh/h of each level that a side shows, both per lane, by section."""
    diagrams: dict[int, dict[str, Points]] = {}
    for section in itertools.count():
        if f"section_{section}_level_{next(iter(LEVELS))}_volume_vehph" not in result.measures:
            return diagrams
        diagrams[section] = {side: [] for side in SIDES}
        for level, side in itertools.product(LEVELS, SIDES):
            volume, speed = (
                result.measures[f"section_{section}_level_{level}_{what}"][side]
                for what in ("volume_vehph", "speed_mps")
            )
            if volume is not None and speed:
                diagrams[section][side].append((volume / kmh_from_mps(speed), volume))
    return diagrams
