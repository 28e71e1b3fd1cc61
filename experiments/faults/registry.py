"""The attacks, by name. A new one is a module with an `ATTACK`, and a line here."""

from collections.abc import Mapping, Sequence

from experiments.faults import determinism, disk, failing_candidates, kills, soak, starts_at_once, sumo_workers
from experiments.faults.attack import Attack
from experiments.faults.hostile import trials as hostile
from experiments.faults.mutated_cases import trials as mutated_cases
from jaxcalib.errors import CaseError, quote

ATTACKS: Mapping[str, Attack] = {
    "failing_candidates": failing_candidates.ATTACK,
    "mutated_cases": mutated_cases.ATTACK,
    "hostile": hostile.ATTACK,
    "starts_at_once": starts_at_once.ATTACK,
    "sumo_workers": sumo_workers.ATTACK,
    "disk": disk.ATTACK,
    "determinism": determinism.ATTACK,
    "soak": soak.ATTACK,
    "kills": kills.ATTACK,
}  # the quickest first


def chosen_attacks(names: Sequence[str]) -> dict[str, Attack]:
    """Return attacks by name; all of them for none.

    Raises:
        CaseError: a name is not known.
    """
    for name in names:
        if name not in ATTACKS:
            raise CaseError("command line", "--only", f"expected some of {', '.join(ATTACKS)}; got {quote(name)}.")
    return {name: ATTACKS[name] for name in ATTACKS if not names or name in names}
