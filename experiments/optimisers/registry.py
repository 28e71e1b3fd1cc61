"""The optimisers that are compared: the product's, and others from libraries that the product does not need."""

from collections.abc import Callable, Sequence

from experiments.optimisers.bayesian import Bayesian
from experiments.optimisers.cma_es import CmaEs
from experiments.optimisers.differential_evolution import differential_evolution
from experiments.optimisers.genetic_algorithm import genetic_algorithm
from experiments.optimisers.saga_polish import SagaPolish
from experiments.optimisers.tpe import Tpe
from jaxcalib.errors import CaseError, quote
from jaxcalib.search import registry
from jaxcalib.search.optimiser import Optimiser

OPTIMISERS: dict[str, Callable[[], Optimiser]] = {
    **registry.OPTIMISERS,
    "genetic_algorithm": genetic_algorithm,
    "differential_evolution": differential_evolution,
    "cma_es": CmaEs,
    "tpe": Tpe,
    "bayesian": Bayesian,
    "saga_polish": SagaPolish,
}


def chosen_optimisers(names: Sequence[str]) -> tuple[str, ...]:
    """Return known names, each once; all of them for none.

    Raises:
        CaseError: a name is not known.
    """
    for name in names:
        if name not in OPTIMISERS:
            raise CaseError("--optimiser", "", f"expected some of {', '.join(OPTIMISERS)}; got {quote(name)}.")
    return tuple(dict.fromkeys(names)) or tuple(OPTIMISERS)
