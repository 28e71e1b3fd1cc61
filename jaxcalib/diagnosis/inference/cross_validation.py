"""Whether an effect that was fitted to some drives predicts others: what only soaks up differences does not.

Evidence lets a signature be wrong by a share of its size, and a large signature of the wrong shape may pass for noise
of the right size. So each effect is fitted to half of the drives to fit, parameters and all, and judged on the other
half by what it predicts there, errors included, and the other way round. Without the errors a right signature that is
off by a third in a jam would be out of the race, too. Held-out drives stay untouched for how far the gap shrinks.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.investigation import NotTestableError, Prepared, moved
from jaxcalib.diagnosis.inference.marginal_likelihood import (
    alike_errors,
    explain,
    knees_of,
    log_density,
    predicted,
    signature_behind,
    squeezed,
)
from surrogate.effects.registry import effect_named

FEWEST_DRIVES = 4  # two in each half


def cross_validated_gains(
    names: Sequence[str],
    fitted: Prepared,
    prepare_some: Callable[[DriveTallies], Prepared],
    signatures: Mapping[str, Sequence[Signature]],
    num_places: Mapping[str, int],
) -> dict[str, float]:
    """Gain of each effect in the log-likelihood of drives that it was not fitted to, both halves together.

    Empty where there are too few drives to tell.
    """
    if len(fitted.tallies) < FEWEST_DRIVES:
        return {}
    halves = [np.arange(first, len(fitted.tallies), 2) for first in (0, 1)]
    try:
        parts = [prepare_some(fitted.tallies.take(half)) for half in halves]
    except NotTestableError:
        return {}
    gains = dict.fromkeys([name for name in names if name in signatures], 0.0)
    for fitted_half, other_half in (parts, parts[::-1]):
        knees = knees_of(other_half.null.cells)
        judged = squeezed(other_half.difference, knees)
        before = log_density(judged, other_half.null.covariance)[0]
        for name in gains:
            several = [moved(signature, fitted, fitted_half) for signature in signatures[name]]
            medium, places = effect_named(name).medium, num_places.get(name, 1)
            explained = explain(fitted_half.difference, fitted_half.null, several, medium, places)
            best = moved(signature_behind(several, explained), fitted_half, other_half)
            strength = best.strengths[-1] if best.is_fixed else abs(explained.strength)
            shift, uncertain = predicted(best, strength, alike_errors(other_half.null), knees)
            covariance = other_half.null.covariance + uncertain
            gains[name] += log_density(judged - shift, covariance)[0] - before
    return gains
