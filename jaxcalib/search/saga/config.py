"""Options of the adaptive genetic algorithm, with the values of the paper where it gives them."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class SagaConfig:
    """Options of SAGA.

    Raises:
        ValueError: an option is out of its range.

    Source: the input of Algorithm 3, values of Section 5.4; "srinivas": Srinivas & Patnaik (1994).
    Deviation: crossover, number of elites and kind of selection are not in the paper.
    """

    population_size: int = 20  # N_p >= 2 (literal: >= 3)
    num_generations: int = 15  # G_max >= 1, generations that are evaluated (literal: one more)
    crossover_probability_min: float = 0.6  # P_c,min
    crossover_probability_max: float = 0.9  # P_c,max
    mutation_probability_min: float = 0.05  # P_m,min
    mutation_probability_max: float = 0.25  # P_m,max
    accuracy_threshold: float = 0.8  # a_thre
    stop_at_threshold: bool = True  # whether reaching the threshold ends the search
    num_elites: int = 1  # best candidates of a generation that survive unchanged (none if literal)
    # "roulette" by windowed accuracy or "rank" (literal: by accuracy itself)
    selection: Literal["roulette", "rank"] = "roulette"
    crossover: Literal["blx", "uniform"] = "blx"  # "blx" or "uniform"
    blend_alpha: float = 0.5  # of "blx", >= 0
    # which accuracy enters Eqs. 21-22. "pair_mean": the mean of both parents, as in the paper; "srinivas": of the
    # better parent for crossover, of the own parent for mutation.
    probability_mode: Literal["pair_mean", "srinivas"] = "pair_mean"
    literal: bool = False  # Algorithm 3 as printed

    def __post_init__(self) -> None:
        """Check the options."""
        fewest = 3 if self.literal else 2
        if self.population_size < fewest or self.num_generations < 1:
            raise ValueError(
                f"Expected a population of at least {fewest} and at least 1 generation; got {self.population_size} and "
                f"{self.num_generations}."
            )
        for name, low, high in (
            ("crossover", self.crossover_probability_min, self.crossover_probability_max),
            ("mutation", self.mutation_probability_min, self.mutation_probability_max),
        ):
            if not 0.0 <= low <= high <= 1.0:
                raise ValueError(f"Expected 0 <= min <= max <= 1 for the {name} probability; got {low} and {high}.")
        if not 0 <= self.num_elites < self.population_size:
            raise ValueError(f"Expected 0 to {self.population_size - 1} elites; got {self.num_elites}.")
        if not self.blend_alpha >= 0.0:
            raise ValueError(f"Expected blend_alpha >= 0; got {self.blend_alpha}.")
        for name, choice, known in (
            ("selection", self.selection, ("roulette", "rank")),
            ("crossover", self.crossover, ("blx", "uniform")),
            ("probability_mode", self.probability_mode, ("pair_mean", "srinivas")),
        ):
            if choice not in known:
                raise ValueError(f"Expected {name} among {known}; got {choice!r}.")
