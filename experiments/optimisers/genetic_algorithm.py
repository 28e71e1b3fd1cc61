"""A plain genetic algorithm: pymoo's, with its tournament, simulated binary crossover and polynomial mutation."""

from pymoo.algorithms.soo.nonconvex.ga import GA

from experiments.optimisers.pymoo_population import PymooSearch
from jaxcalib.search.optimisers.saga import POPULATION


def genetic_algorithm() -> PymooSearch:
    """Return it with SAGA's population, so that the two differ in their operators alone."""
    return PymooSearch(lambda first: GA(pop_size=len(first), sampling=first), POPULATION)  # pyright: ignore
