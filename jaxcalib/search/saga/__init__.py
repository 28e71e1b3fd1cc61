"""Simulation-based adaptive genetic algorithm (SAGA), the paper's Algorithm 3."""

from jaxcalib.search.saga.search import ask, init, tell

__all__ = ["ask", "init", "tell"]
