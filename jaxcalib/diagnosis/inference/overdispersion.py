"""How sure evidence may be: by how much more the best explanation leaves than chance does.

An explanation that is right in kind is wrong in detail, and its errors are alike in neighbouring features, which the
evidence counts as independent. What the best one leaves beyond chance tells how much that is: evidence between
explanations is divided by it, as a quasi-likelihood is by the inflation of its variance.

Source: Burnham and Anderson (2002), Model Selection and Multimodel Inference, sec. 2.5; McCullagh and Nelder (1989),
Generalized Linear Models, sec. 4.5.
"""

from collections.abc import Sequence

import numpy as np

from jaxcalib.diagnosis.inference.marginal_likelihood import Explained

# What a right explanation leaves at best: its noise is known from the same runs, which makes them look alike.
LEAST_TEMPERATURE = 2.0


def temperature_at(misfit: float, by_chance: float) -> float:
    """Return what evidence is divided by where the best explanation leaves a misfit, and chance another."""
    return LEAST_TEMPERATURE * max(1.0, misfit / by_chance)


def temperature(explained: Sequence[Explained], by_chance: float) -> float:
    """Return what evidence between explanations, best first, is divided by."""
    misfits = (each.best_misfit for each in explained if each.is_effect and np.isfinite(each.best_misfit))
    return temperature_at(next(misfits, 0.0), by_chance)
