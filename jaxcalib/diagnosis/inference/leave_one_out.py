"""What of the evidence no single drive makes.

Jams come in some drives only, and their noise has a longer tail than any covariance tells; an effect shows in most.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.investigation import NotTestableError, Prepared, moved
from jaxcalib.diagnosis.inference.marginal_likelihood import Explained, best_gain

Signatures = Mapping[str, Sequence[Signature]]


def least_gain(
    fitted: Prepared,
    signatures: Signatures,
    prepare_some: Callable[[DriveTallies], Prepared],
    explain: Callable[[Prepared, Signatures], Sequence[Explained]],
) -> float:
    """Return the gain of the best explanation over the baseline without the drive that favours it most.

    Args:
        fitted: null model and features of the drives to fit.
        signatures: of all effects.
        prepare_some: prepares some of the drives.
        explain: judges such drives by signatures.
    """
    everyone = np.arange(len(fitted.tallies))
    gains = []
    for left_out in everyone:
        try:
            some = prepare_some(fitted.tallies.take(np.setdiff1d(everyone, [left_out])))
        except NotTestableError:
            continue  # the others alone show too little
        there = {
            name: [moved(signature, fitted, some) for signature in several] for name, several in signatures.items()
        }
        gains.append(best_gain(explain(some, there)))
    return min(gains, default=0.0)
