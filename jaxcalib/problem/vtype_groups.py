"""Which background vTypes move together, and which have driver parameters of their own: `[behaviour] apart`."""

from collections.abc import Mapping, Sequence

from jaxcalib.case.case import Behaviour
from jaxcalib.case.case_file import FILE_NAME
from jaxcalib.errors import CaseError, quote
from sim_adapters.scenario.scenario import Scenario

TRUCK_CLASSES = ("truck", "trailer", "bus", "coach")  # vehicle classes that `apart = "trucks"` takes from the others
PLACE = "behaviour.apart"

Groups = tuple[tuple[str, ...], ...]


def groups_of(behaviour: Behaviour, scenario: Scenario) -> Groups:
    """Return the groups of vTypes, each of which has driver parameters of its own.

    Args:
        behaviour: names the vTypes, and says which of them move apart.
        scenario: for their vehicle classes, and for who enters.

    Raises:
        CaseError: a group is empty, groups by hand are not the vTypes, or nobody enters of a group's first vType, whose
            values are those that a calibration moves.
    """
    groups = _groups(behaviour, scenario.demand.vtypes)
    entering = {flow.vtype for flow in scenario.flows} | set(behaviour.distant_vtypes.values())
    entering.add(scenario.demand.subject_vtype)
    for group in groups:
        first, *others = group
        if first in scenario.demand.vtypes and first not in entering:
            remedy = "put another first" if others else "leave it out of behaviour.vtypes"
            expected = f"expected vehicles of vType {quote(first)} on the route, as the first of its group; there "
            place = "behaviour.vtypes" if behaviour.apart is None else PLACE
            raise CaseError(FILE_NAME, place, f"{expected}are none: {remedy}.")
    return groups


def _groups(behaviour: Behaviour, attributes: Mapping[str, Mapping[str, str]]) -> Groups:
    vtypes, apart = behaviour.vtypes, behaviour.apart
    if apart is None:
        return (vtypes,)
    if apart == "each":
        return tuple((vtype,) for vtype in vtypes)
    if apart == "trucks":
        return _trucks_apart(vtypes, [_is_truck(attributes.get(vtype, {})) for vtype in vtypes])
    _check_by_hand(vtypes, [vtype for group in apart for vtype in group])
    return apart


def _is_truck(attributes: Mapping[str, str]) -> bool:
    """Whether a vType is of trucks or buses: by its vClass, or, where it has none, by how it is drawn."""
    drawn, *_ = attributes.get("guiShape", "").split("/")  # "truck/semitrailer", "bus/coach"
    return attributes.get("vClass", drawn) in TRUCK_CLASSES


def _trucks_apart(vtypes: Sequence[str], is_truck: Sequence[bool]) -> Groups:
    """Return trucks behind all others: logs say most of those whom they meet most."""
    chosen = list(zip(vtypes, is_truck, strict=True))
    trucks, others = (tuple(vtype for vtype, one in chosen if one == wanted) for wanted in (True, False))
    if trucks and others:
        return others, trucks
    lacking = "others beside" if trucks else "some of"
    classes = f"{', '.join(TRUCK_CLASSES[:-1])} or {TRUCK_CLASSES[-1]}"
    expected = f"expected {lacking} vClass {classes} among behaviour.vtypes ({', '.join(vtypes)}); there are none."
    raise CaseError(FILE_NAME, PLACE, expected)


def _check_by_hand(vtypes: Sequence[str], grouped: Sequence[str]) -> None:
    """Refuse groups that are not all of the vTypes, each once.

    Raises:
        CaseError: they are not.
    """
    for index, vtype in enumerate(grouped):
        if vtype not in vtypes:
            expected = f"expected vTypes of behaviour.vtypes ({', '.join(vtypes)}), got {quote(vtype)}."
            raise CaseError(FILE_NAME, PLACE, expected)
        if vtype in grouped[:index]:
            raise CaseError(FILE_NAME, PLACE, f"expected each vType in one group, got {quote(vtype)} again.")
    for vtype in vtypes:
        if vtype not in grouped:
            raise CaseError(FILE_NAME, PLACE, f"expected every vType in a group; {quote(vtype)} is in none.")
