"""The result of one run that answers several requests."""

from sim_adapters.sumo.job import SumoRun
from sim_adapters.sumo.workers import BegunRun


class SharedResult:
    """What is left of a run, for as many requests as it answers; then it is let go."""

    def __init__(self, begun: BegunRun, num_answers: int) -> None:
        """Keep the run.

        Args:
            begun: the run, which has been begun.
            num_answers: how often its result is asked for.
        """
        self._begun: BegunRun | None = begun
        self._num_to_answer = num_answers
        self._result: SumoRun | str | None = None

    def get(self) -> SumoRun | str:
        """Wait for the run and return it; the last words of SUMO where it failed for good."""
        if self._begun is not None:
            self._result, self._begun = self._begun.result(), None
        result = self._result
        assert result is not None
        self._num_to_answer -= 1
        if not self._num_to_answer:
            self._result = None
        return result
