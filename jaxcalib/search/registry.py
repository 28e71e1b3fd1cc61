"""The optimisers that `jaxcalib calibrate` can be told to use, by name.

A new one is a file and a line here; the laws of `tests/jaxcalib/search/test_optimiser_laws.py` then run for it, and the
study of `experiments/optimisers` compares it with the others.
"""

from collections.abc import Callable

from jaxcalib.search.optimiser import Optimiser
from jaxcalib.search.optimisers.gradient_descent import GradientDescent
from jaxcalib.search.optimisers.random_search import RandomSearch
from jaxcalib.search.optimisers.saga import Saga
from jaxcalib.search.optimisers.sobol_search import SobolSearch
from jaxcalib.search.optimisers.spsa import Spsa
from jaxcalib.search.optimisers.trust_region import TrustRegion

OPTIMISERS: dict[str, Callable[[], Optimiser]] = {
    "trust_region": TrustRegion,
    "saga": Saga,
    "saga_literal": lambda: Saga(literal=True),
    "spsa": Spsa,
    "gradient_descent": GradientDescent,
    "random": RandomSearch,
    "sobol": SobolSearch,
}
