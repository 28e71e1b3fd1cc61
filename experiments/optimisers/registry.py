"""All optimisers by name. A new one is a file and a line here; the laws of `tests/optimisers` then run for it."""

from collections.abc import Callable, Sequence

from experiments.optimisers.bayesian import Bayesian
from experiments.optimisers.cma_es import CmaEs
from experiments.optimisers.differential_evolution import differential_evolution
from experiments.optimisers.genetic_algorithm import genetic_algorithm
from experiments.optimisers.gradient_descent import GradientDescent
from experiments.optimisers.interface import Optimiser
from experiments.optimisers.random_search import RandomSearch
from experiments.optimisers.saga_polish import SagaPolish
from experiments.optimisers.saga_search import Saga
from experiments.optimisers.sobol_search import SobolSearch
from experiments.optimisers.spsa import Spsa
from experiments.optimisers.tpe import Tpe
from experiments.optimisers.trust_region_search import TrustRegion
from jaxcalib.errors import CaseError, quote

OPTIMISERS: dict[str, Callable[[], Optimiser]] = {
    "saga": Saga,
    "saga_literal": lambda: Saga(literal=True),
    "genetic_algorithm": genetic_algorithm,
    "differential_evolution": differential_evolution,
    "cma_es": CmaEs,
    "spsa": Spsa,
    "tpe": Tpe,
    "bayesian": Bayesian,
    "gradient_descent": GradientDescent,
    "random": RandomSearch,
    "sobol": SobolSearch,
    "trust_region": TrustRegion,
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
