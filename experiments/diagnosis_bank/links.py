"""Links of the chain of inference that can be switched off, to see what each buys."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from unittest.mock import patch

from jaxcalib.diagnosis.features import noise
from jaxcalib.diagnosis.inference import marginal_likelihood, pairs
from jaxcalib.diagnosis.inference.overdispersion import LEAST_TEMPERATURE
from jaxcalib.diagnosis.stages import judged, refitted, tried

LINKS = {
    "leave_one_out": [(judged, "least_gain", lambda *_: float("inf"))],
    "tempering": [
        (judged, "temperature", lambda explained, by_chance: LEAST_TEMPERATURE),
        (pairs, "temperature_at", lambda misfit, by_chance: LEAST_TEMPERATURE),
    ],
    "squeezing": [(marginal_likelihood, "KNEE", 1e6)],
    "heavy_tail": [(noise, "MOST_TAIL", 1.0)],
    "refit": [(refitted, "contenders", lambda explained, signatures, verdict: [])],
    "places": [(tried, "_refined", lambda session, baseline, book, found: found)],
}


@contextmanager
def without(names: Sequence[str]) -> Iterator[None]:
    """Switch links off for a while."""
    with ExitStack() as stack:
        for name in names:
            for owner, attribute, instead in LINKS[name]:
                stack.enter_context(patch.object(owner, attribute, instead))
        yield
