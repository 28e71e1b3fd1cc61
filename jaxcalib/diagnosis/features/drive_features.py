"""All features of one drive, whoever recorded or simulated it."""

from dataclasses import dataclass

from jaxcalib.diagnosis.features.closed_loop import count_closed_loop
from jaxcalib.diagnosis.features.conventions import Conventions, ExpectedDrivers
from jaxcalib.diagnosis.features.features import TallyBook
from jaxcalib.diagnosis.features.identities import count_identities
from jaxcalib.diagnosis.features.replay import count_replay
from surrogate.road.drive_table import DriveTable


@dataclass(frozen=True)
class DriveFeatures:
    """Counts the features of drives."""

    road: Conventions
    background: ExpectedDrivers
    subject: ExpectedDrivers  # expected subject vehicle
    frame_interval_s: float  # at which traffic is judged; tables have that interval, or a whole part of it

    def of_table(self, table: DriveTable) -> TallyBook:
        """Return the tallies of a drive; identities are left out where instants are too far apart for them."""
        book = TallyBook()
        steps = max(1, round(self.frame_interval_s / table.interval_s))
        if steps > 1:
            count_identities(table, self.road, book)
        coarse = table.coarser(steps)
        count_closed_loop(coarse, self.road, book)
        count_replay(coarse, self.road, self.background, self.subject, book)
        return book
