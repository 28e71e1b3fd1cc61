"""What an effect does to the features, by its strength."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Signature:
    """What an effect at one place and time does to the features, in units of noise."""

    effect: str  # name of the effect
    setting: Mapping[str, float]  # place, time and choice, for people
    strengths: np.ndarray  # strengths at which it is known, from 0
    shift: np.ndarray  # difference from the baseline at each strength, [strength, feature]; zeros at strength 0
    error: np.ndarray  # its standard error
    # share of SIGNATURE_ERROR that applies, in all features or in each; less than 1 where the signature is nearly
    # exact
    exactness: float | np.ndarray = 1.0
    sign: float = 1.0  # of the strengths, which are kept as sizes
    is_fixed: bool = False  # whether it holds at its own strength only: a rhythm, or a duration with its place in time
    # whether its runs showed the features, of all or of each; shift and error of one that they did not are 0
    is_shown: bool | np.ndarray = True

    @property
    def exponent(self) -> float:
        """Power of the strength with which the signature grows from 0 to the weakest known one.

        It is that between the two weakest known ones, from 1 to 2: what makes drivers differ, or accelerations noisy,
        shows as a variance, and half of it shows by a quarter.
        """
        if len(self.strengths) < 3:
            return 1.0
        size = np.sqrt(np.maximum(np.sum(self.shift[1:3] ** 2 - self.error[1:3] ** 2, axis=1), 0.0))
        if not np.all(size > 0.0):
            return 1.0
        return float(np.clip(np.log(size[1] / size[0]) / np.log(self.strengths[2] / self.strengths[1]), 1.0, 2.0))

    def at(self, strength: float) -> tuple[np.ndarray, np.ndarray]:
        """Return shift and error at a strength.

        From 0 to the weakest known one they grow with a power of the strength; then they are linear, beyond the last
        known one, too.
        """
        s = self.strengths
        if 0.0 < strength < s[1]:
            share = (strength / s[1]) ** self.exponent
            return share * self.shift[1], share * self.error[1]
        upper = int(np.clip(np.searchsorted(s, strength), 1, len(s) - 1))
        weight = (strength - s[upper - 1]) / (s[upper] - s[upper - 1])
        shift = (1 - weight) * self.shift[upper - 1] + weight * self.shift[upper]
        error = np.hypot((1 - weight) * self.error[upper - 1], weight * self.error[upper])
        return shift, error
