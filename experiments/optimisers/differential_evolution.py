"""Differential evolution: pymoo's, with its default variant."""

from pymoo.algorithms.soo.nonconvex.de import DE

from experiments.optimisers.pymoo_population import PymooSearch
from jaxcalib.search.optimisers.saga import POPULATION

VARIANT = "DE/best/1/bin"  # the others learn too slowly for hundreds of evaluations
CROSSOVER_PROBABILITY = 0.7
SCALE = 0.5


def differential_evolution() -> PymooSearch:
    """Return it with SAGA's population."""

    def make(first: object) -> DE:
        return DE(POPULATION, sampling=first, variant=VARIANT, CR=CROSSOVER_PROBABILITY, F=SCALE)  # pyright: ignore

    return PymooSearch(make, POPULATION)
