"""validation.html."""

from markupsafe import Markup

from jaxcalib.html.page import render_page
from jaxcalib.validation.diagrams import diagrams_figure
from jaxcalib.validation.equivalence import MOST_MORE
from jaxcalib.validation.figures import distances_figure, margins_figure, measures_figure
from jaxcalib.validation.result import ValidationResult


def validation_html(result: ValidationResult) -> str:
    """Return the page of a validation."""
    answered = [criterion for criterion in result.criteria if criterion.passes is not None]
    return render_page(
        "validation.html.j2",
        result=result,
        num_passed=sum(bool(criterion.passes) for criterion in answered),
        num_answered=len(answered),
        most_more=MOST_MORE,
        margins=Markup(margins_figure(result)),
        measures=Markup(measures_figure(result)),
        distances=Markup(distances_figure(result)),
        diagrams=Markup(diagrams_figure(result)),
        number=lambda value: "-" if value is None else f"{value:.4g}",
        interval=lambda bounds: "-" if bounds is None else f"{bounds[0]:.4g} to {bounds[1]:.4g}",
    )
