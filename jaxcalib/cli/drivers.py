"""Commands about drivers and what may be missing of them."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from jaxcalib.cli.options import WholeNumber


def fit_following(
    pairs: Path,
    /,
    *,
    out: Path,
    model: str = "idm",
    held_out_share: Annotated[float, Parameter(validator=Number(gte=0.0, lte=0.8))] = 0.5,
    drop_bad_pairs: Annotated[bool, Parameter(negative="")] = False,
    seed: Annotated[WholeNumber, Parameter(validator=Number(gte=0))] = 0,
) -> int:
    """Fit a car-following model to recorded leader-follower pairs, all at once.

    Leaves pairs.csv (parameters, standard errors and errors of each pair) and population.json in the folder of --out.

    Parameters
    ----------
    pairs
        Table with the columns pair_id, time_s, v_lead_mps, v_foll_mps and gap_m (.csv, .csv.gz or .parquet).
    out
        Folder for the results.
    model
        Car-following model, for example idm, krauss or w99-sumo128; docs/parameters.md lists them all.
    held_out_share
        Last part of each pair that is not fitted but judged.
    drop_bad_pairs
        Leave out pairs with gaps of 0 or less, without a leader, or with jumps in time, instead of stopping.
    seed
        Seed of the starts.
    """
    from jaxcalib.cli.guarded import guarded
    from jaxcalib.cli.pair_fitting_terminal import pair_progress, print_summary
    from jaxcalib.errors import CaseError
    from jaxcalib.pair_fitting.pair_physics import believed_pairs
    from jaxcalib.pair_fitting.recorded_pairs import read_pairs
    from jaxcalib.pair_fitting.study import study_pairs
    from jaxcalib.runs.disk import check_out, writing_to
    from surrogate.car_following.registry import car_following_model
    from surrogate.vehicle.model_entry import UnknownModelError

    def work() -> str:
        try:
            entry = car_following_model(model)
        except UnknownModelError as error:
            raise CaseError("command line", "--model", f"expected a known name: {error}") from None
        check_out(out)
        recorded, dropped = read_pairs(pairs, drop_bad_pairs)
        recorded, doubted = believed_pairs(pairs, recorded)
        with pair_progress(len(recorded)) as on_pairs:
            study = study_pairs(entry, recorded, [*dropped, *doubted], held_out_share, seed, on_pairs)
        with writing_to(out):
            study.write(out)
        print_summary(study, out)
        return ""

    return guarded(work, "nothing was written.")


def effects() -> int:
    """List the effects that a simulation may lack: where each acts, its unit, range of strength and source."""
    from jaxcalib.cli.effect_list import print_effects

    print_effects()
    return 0
