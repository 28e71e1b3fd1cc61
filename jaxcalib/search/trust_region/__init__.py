"""Local search for noisy, smooth residual vectors: Gauss-Newton on response surfaces."""

from jaxcalib.search.trust_region.search import ask, init, tell

__all__ = ["ask", "init", "tell"]
