"""All that the drives of a case contradict themselves in."""

from collections.abc import Sequence

from jaxcalib.field.physics.contradiction import Contradiction, merged
from jaxcalib.field.physics.impossible_tracks import ImpossibleRows
from jaxcalib.field.physics.motion import BLOCKS_PER_DRIVE, DriveMotion, subject_windows
from jaxcalib.field.physics.object_identities import object_contradictions
from jaxcalib.field.physics.same_motion import same_motions
from jaxcalib.field.physics.subject_identities import speed_scales, subject_contradictions


def judge_drives(motions: Sequence[DriveMotion], impossible: Sequence[ImpossibleRows]) -> list[Contradiction]:
    """Contradictions of drives, those that are refused first.

    Args:
        motions: of each drive, rows that no vehicle can have made left out.
        impossible: these rows, of each drive.
    """
    windows = [subject_windows(motion, BLOCKS_PER_DRIVE * number) for number, motion in enumerate(motions)]
    of_subject = subject_contradictions(motions, windows)
    of_tracks = [one for motion, rows in zip(motions, impossible, strict=True) for one in rows.contradictions(motion)]
    found = [
        *of_subject,
        *object_contradictions(motions, speed_scales(windows)),
        *same_motions(motions),
        *merged(of_tracks),
    ]
    if any(one.kind == "speed_delay" for one in of_subject):  # then the objects' clock seems to differ as well
        found = [one for one in found if one.kind != "clock_offset" or one.is_refused]
    return sorted(found, key=lambda contradiction: not contradiction.is_refused)
