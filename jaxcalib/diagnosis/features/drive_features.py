"""All features of one drive, whoever recorded or simulated it."""

from dataclasses import dataclass

from jaxcalib.diagnosis.features.closed_loop import count_closed_loop
from jaxcalib.diagnosis.features.conventions import Conventions, ExpectedDrivers
from jaxcalib.diagnosis.features.features import TallyBook
from jaxcalib.diagnosis.features.identities import count_identities
from jaxcalib.diagnosis.features.replay import count_replay
from jaxcalib.problem.problem import FRAME_INTERVAL_S
from surrogate.road.drive_table import DriveTable


@dataclass(frozen=True)
class DriveFeatures:
    """Counts the features of drives."""

    road: Conventions
    background: ExpectedDrivers
    subject: ExpectedDrivers  # expected subject vehicle

    def of_table(self, table: DriveTable) -> TallyBook:
        """Return the tallies of a drive; identities are left out where instants are too far apart for them."""
        book = TallyBook()
        steps = max(1, round(FRAME_INTERVAL_S / table.interval_s))
        if table.interval_s < FRAME_INTERVAL_S:
            count_identities(table, self.road, book)
        coarse = table.coarser(steps)
        count_closed_loop(coarse, self.road, book)
        count_replay(coarse, self.road, self.background, self.subject, book)
        return book
