"""validation.html."""

from markupsafe import Markup

from jaxcalib.html.page import render_page
from jaxcalib.validation.figures import distances_figure, measures_figure
from jaxcalib.validation.result import ValidationResult


def validation_html(result: ValidationResult) -> str:
    """Return the page of a validation."""
    answered = [one for one in result.criteria if one.passes is not None]
    return render_page(
        "validation.html.j2",
        result=result,
        num_passed=sum(bool(one.passes) for one in answered),
        num_answered=len(answered),
        measures=Markup(measures_figure(result)),
        distances=Markup(distances_figure(result)),
        number=lambda value: "-" if value is None else f"{value:.4g}",
        interval=lambda bounds: "-" if bounds is None else f"{bounds[0]:.4g} to {bounds[1]:.4g}",
    )
