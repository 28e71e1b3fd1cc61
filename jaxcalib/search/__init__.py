"""Searches of a parameter space that never see a simulator: init, ask for candidates, tell how they did.

Each search is a module of free functions `init`, `ask` and `tell` over frozen records:

- `soat`: all cases of an orthogonal array (Algorithm 1);
- `saga`: the adaptive genetic algorithm (Algorithm 3);
- `trust_region`: Gauss-Newton on response surfaces, for residual vectors.

Beside them stand `orthogonal_array`, which builds the designs, and `analyse_ranges`, which finds the critical
parameters and says what it cannot know (Algorithm 2).
"""

from jaxcalib.search import saga, soat, trust_region
from jaxcalib.search.evaluation import SearchStatus
from jaxcalib.search.least_squares.surface_step import GaussianPrior
from jaxcalib.search.orthogonal_arrays.orthogonal_array import OrthogonalArray, array_sizes, orthogonal_array
from jaxcalib.search.range_analysis.analysis_of_variance import AnalysisOfVariance
from jaxcalib.search.range_analysis.noise import RangeNoise
from jaxcalib.search.range_analysis.ranges import NO_LEVEL, RangeAnalysis, RangeAnalysisConfig, analyse_ranges
from jaxcalib.search.saga.config import SagaConfig
from jaxcalib.search.saga.search import SagaInfo, SagaState
from jaxcalib.search.soat import SoatConfig, SoatInfo, SoatState, level_values, points_from_levels
from jaxcalib.search.trust_region.records import TrustRegionConfig, TrustRegionInfo, TrustRegionState

__all__ = [
    "NO_LEVEL",
    "AnalysisOfVariance",
    "GaussianPrior",
    "OrthogonalArray",
    "RangeAnalysis",
    "RangeAnalysisConfig",
    "RangeNoise",
    "SagaConfig",
    "SagaInfo",
    "SagaState",
    "SearchStatus",
    "SoatConfig",
    "SoatInfo",
    "SoatState",
    "TrustRegionConfig",
    "TrustRegionInfo",
    "TrustRegionState",
    "analyse_ranges",
    "array_sizes",
    "level_values",
    "orthogonal_array",
    "points_from_levels",
    "saga",
    "soat",
    "trust_region",
]
