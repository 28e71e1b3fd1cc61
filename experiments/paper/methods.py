"""The methods that are compared, and the parts of ours that can be left out."""

from collections.abc import Callable

import msgspec

from jaxcalib.problem.settings import Settings

NO_CALIBRATION, STATE_OF_THE_ART, PRINTED, IMPROVED = "no_calibration", "state_of_the_art", "printed", "improved"
METHODS = (NO_CALIBRATION, STATE_OF_THE_ART, PRINTED, IMPROVED)
LABELS = {
    NO_CALIBRATION: "no calibration",
    STATE_OF_THE_ART: "state of the art",
    PRINTED: "method as printed",
    IMPROVED: "method as improved",
}
PAPER_THRESHOLD = 0.8  # Section 5.4


def label_of(method: str) -> str:
    """Return a method's name as tables and figures have it."""
    return LABELS.get(method, method.replace("_", " "))


def settings_of(method: str, common: Settings) -> Settings:
    """Return the settings of a two-stage method: PRINTED, IMPROVED, or the name of an ablation."""
    if method == PRINTED:
        return msgspec.structs.replace(
            common,
            objective="paper",
            literal=True,
            accuracy_threshold=common.accuracy_threshold or PAPER_THRESHOLD,
            without=("logs", "polish", "gradients", "correction"),
        )
    if method == IMPROVED:
        return common
    return ABLATIONS[method](common)


# What each part buys: the method as improved without it.
ABLATIONS: dict[str, Callable[[Settings], Settings]] = {
    "without_logs": lambda common: msgspec.structs.replace(common, without=(*common.without, "logs")),
    "without_screening": lambda common: msgspec.structs.replace(common, num_critical=50),
    "without_optimiser": lambda common: msgspec.structs.replace(common, without=(*common.without, "optimiser")),
    "with_saga": lambda common: msgspec.structs.replace(common, optimiser="saga"),
    "without_polish": lambda common: msgspec.structs.replace(common, without=(*common.without, "polish")),
    "without_gradients": lambda common: msgspec.structs.replace(common, without=(*common.without, "gradients")),
    "without_correction": lambda common: msgspec.structs.replace(common, without=(*common.without, "correction")),
    "without_whitening": lambda common: msgspec.structs.replace(common, objective="paper"),
}
