"""SAGA, then Gauss-Newton from its best: what `jaxcalib calibrate` with `optimiser = "saga"` does after screening."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told, info_of
from jaxcalib.search.optimisers.saga import POPULATION, Saga
from jaxcalib.search.optimisers.trust_region import RestartedState, TrustRegion
from jaxcalib.search.saga.search import SagaState

SAGA_SHARE = 0.6  # of the evaluations; the polish takes the rest


@dataclass(frozen=True)
class TwoPhaseState:
    """The phase that runs."""

    setting: Setting
    saga: SagaState
    polish: RestartedState | None = None


class SagaPolish(Optimiser):
    """SAGA for a share of the evaluations, then the trust region around the best candidate."""

    def __init__(self) -> None:
        """Prepare both phases."""
        self._saga, self._trust_region = Saga(), TrustRegion()

    def init(self, setting: Setting) -> TwoPhaseState:
        """Return the first state."""
        for_saga = max(POPULATION, round(SAGA_SHARE * setting.num_evaluations))
        return TwoPhaseState(setting, self._saga.init(replace(setting, num_evaluations=for_saga)))

    def ask(self, state: TwoPhaseState) -> Float[np.ndarray, "candidate parameter"]:
        """Return the candidates of the phase that runs."""
        return self._saga.ask(state.saga) if state.polish is None else self._trust_region.ask(state.polish)

    def tell(self, state: TwoPhaseState, told: Told) -> tuple[TwoPhaseState, RoundInfo]:
        """Return the state after a round of either phase."""
        if state.polish is not None:
            polish, info = self._trust_region.tell(state.polish, told)
            return replace(state, polish=polish), info
        saga, info = self._saga.tell(state.saga, told)
        if not saga.status.is_final:
            return replace(state, saga=saga), info
        best = saga.best_candidate if saga.best_candidate is not None else state.setting.start
        polish = self._trust_region.init(replace(state.setting, start=best))
        return replace(state, saga=saga, polish=polish), info_of(told)
