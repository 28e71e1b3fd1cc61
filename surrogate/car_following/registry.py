"""Every car-following model by name.

To add a model: write its file, with the model and its `ModelEntry`, and enter it here; every law test then runs for
it, and `jaxcalib fit-following` fits it.
"""

from surrogate.car_following.asymmetric_optimal_velocity import ASYMMETRIC_OPTIMAL_VELOCITY
from surrogate.car_following.full_velocity_difference import FULL_VELOCITY_DIFFERENCE
from surrogate.car_following.gazis_herman_rothery import GAZIS_HERMAN_ROTHERY
from surrogate.car_following.gipps import GIPPS
from surrogate.car_following.idm import IDM
from surrogate.car_following.improved_idm import ACC, IMPROVED_IDM
from surrogate.car_following.krauss import KRAUSS
from surrogate.car_following.wiedemann99 import WIEDEMANN_99_SUMO
from surrogate.car_following.wiedemann99_vissim import WIEDEMANN_99_VISSIM
from surrogate.vehicle.car_following_model import CarFollowingModel
from surrogate.vehicle.model_entry import ModelEntry, find

CAR_FOLLOWING_MODELS: tuple[ModelEntry[CarFollowingModel], ...] = (
    IDM,
    IMPROVED_IDM,
    ACC,
    KRAUSS,
    WIEDEMANN_99_SUMO,
    WIEDEMANN_99_VISSIM,
    GIPPS,
    GAZIS_HERMAN_ROTHERY,
    FULL_VELOCITY_DIFFERENCE,
    ASYMMETRIC_OPTIMAL_VELOCITY,
)


def car_following_model(name: str) -> ModelEntry[CarFollowingModel]:
    """Return a model of the registry.

    Raises:
        UnknownModelError: there is no such model.
    """
    return find(CAR_FOLLOWING_MODELS, name, "car-following")
