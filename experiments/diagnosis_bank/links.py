"""Links of the chain of inference that can be switched off, to see what each buys."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from unittest.mock import patch

import numpy as np

from jaxcalib.diagnosis.features import noise
from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.inference import left_out, marginal_likelihood, pairs
from jaxcalib.diagnosis.inference.overdispersion import LEAST_TEMPERATURE
from jaxcalib.diagnosis.stages import judged, refitted, tried


def _undivided(drives: DriveTallies, null: noise.NullModel, of_mean: float) -> np.ndarray:
    """All drives in the place of those without one."""
    return np.repeat(left_out.differences_of(drives, null, of_mean)[:1], 2, axis=0)


LINKS = {
    "leave_one_out": [(judged, "differences_of", _undivided)],
    "chance": [(judged, "gain_by_chance", lambda *_: 0.0)],
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
