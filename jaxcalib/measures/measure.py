"""Values made of pooled tallies: means, rates, shares, deviations, percentiles, means under censoring."""

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np


class Level(enum.Enum):
    """What a measure describes (Tables 2 and 3)."""

    VEHICLE = "vehicle"
    TRAFFIC = "traffic"


class Moe(enum.Enum):
    """Measures of effectiveness: whose errors a simulation is judged by, by their names in results."""

    SUBJECT_TIME_HEADWAY = "subject_time_headway"  # Eq. 24
    BACKGROUND_TIME_HEADWAY = "background_time_headway"  # Eqs. 25-27
    SUBJECT_LANE_CHANGE_DISTANCE = "subject_lane_change_distance"  # Eq. 28
    BACKGROUND_LANE_CHANGE_DISTANCE = "background_lane_change_distance"  # Eqs. 29-31
    CUT_INS = "cut_ins"  # Eq. 32
    TRAFFIC_SPEED = "traffic_speed"  # Eq. 33
    TRAFFIC_DENSITY = "traffic_density"  # Eq. 34
    TRAFFIC_VOLUME = "traffic_volume"  # Eq. 35
    TRAFFIC_DYNAMICS = "traffic_dynamics"  # Eq. 36

    @property
    def level(self) -> Level:
        """Vehicle for the terms of Eq. 23."""
        is_flow = self in (Moe.TRAFFIC_SPEED, Moe.TRAFFIC_DENSITY, Moe.TRAFFIC_VOLUME, Moe.TRAFFIC_DYNAMICS)
        return Level.TRAFFIC if is_flow else Level.VEHICLE


class LeftOut(enum.Enum):
    """Why the default objective does not match a quotient."""

    FOLLOWS = "it follows from others, or repeats them in another unit"
    # far from normal where it is rare, and the mean of the distribution is matched already
    BIN = "it is a bin of a distribution"
    # surrogate and SUMO share their equations of motion but not every single acceleration: SUMO averages some limit
    # cycles of one step only in what vehicles do, not in how they accelerate
    SINGLE_STEPS = "it depends on single steps"
    FEW = "a drive shows few of it"
    # tails are what a simulation is judged by, not what it is fitted to, and far from normal
    SAFETY = "it describes the rare and dangerous"


@dataclass(frozen=True)
class MeasureValue:
    """A measured value with its validity."""

    value: float  # the value; nan if it is not valid
    num_observations: float  # how many observations it rests on
    # observations left out because they reached beyond the sensor's range; nan where that cannot be
    num_censored: float = float("nan")
    reason: str = ""  # why it is not valid; empty if it is

    @property
    def is_valid(self) -> bool:
        """Whether there is a value."""
        return not self.reason


@dataclass(frozen=True)
class Measure:
    """A quotient of two tallies, pooled: a mean, rate or share."""

    is_quotient: ClassVar[bool] = True

    name: str  # name in results and reports, with its unit as suffix
    description: str  # one line for people
    level: Level  # vehicle or traffic flow
    numerator: str  # tally
    denominator: str  # tally
    scale: float = 1.0  # factor from SI to the unit of the name
    observations: str = ""  # tally that counts the observations; the denominator unless given
    censored: str = ""  # tally that counts what was left out; none if empty
    left_out: LeftOut | None = None  # why the default objective does not match it; None if it does
    moe: Moe | None = None  # the measure of effectiveness that it gives
    # the one that it gives in the objective as printed, where `moe` is given by what is no quotient
    printed_moe: Moe | None = None

    @property
    def is_matched(self) -> bool:
        """Whether it is a moment of the default objective."""
        return self.is_quotient and self.left_out is None

    @property
    def is_rate(self) -> bool:
        """Whether it counts events over an exposure, of which the events are the observations."""
        return self.observations == self.numerator

    @property
    def is_tested(self) -> bool:
        """Whether a validation asks if chance explains its difference.

        Distributions are compared whole, not bin by bin, and what follows from others would only be asked again.
        """
        return self.moe is not None or self.left_out not in (LeftOut.BIN, LeftOut.FOLLOWS)

    @property
    def is_per_drive(self) -> bool:
        """Whether its observations are drives."""
        return (self.observations or self.denominator) == "drives"

    def num_telling(self, tally: Mapping[str, float]) -> float:
        """How much its value rests on: of what is counted per drive what is counted, else the observations."""
        return tally[self.numerator] if self.is_per_drive else tally[self.observations or self.denominator]

    def tallies(self) -> tuple[str, ...]:
        """The tallies that it needs."""
        return tuple(filter(None, (self.numerator, self.denominator, self.observations, self.censored)))

    def value(self, tally: Mapping[str, float]) -> MeasureValue:
        """The value for pooled tallies."""
        observations = tally[self.observations or self.denominator]
        censored = tally[self.censored] if self.censored else float("nan")
        if not tally[self.denominator] > 0:
            return MeasureValue(float("nan"), observations, censored, "never observed")
        value = self.scale * tally[self.numerator] / tally[self.denominator]
        return MeasureValue(value, observations, censored)


@dataclass(frozen=True)
class Deviation(Measure):
    """Standard deviation from count (denominator), sum (numerator) and sum of squares."""

    is_quotient = False
    squares: str = ""

    def tallies(self) -> tuple[str, ...]:
        """The tallies that it needs."""
        return (*super().tallies(), self.squares)

    def value(self, tally: Mapping[str, float]) -> MeasureValue:
        """The value for pooled tallies."""
        count = tally[self.denominator]
        if not count > 1:
            return MeasureValue(float("nan"), count, reason="fewer than two observations")
        mean = tally[self.numerator] / count
        variance = max(tally[self.squares] / count - mean * mean, 0.0) * count / (count - 1)
        return MeasureValue(self.scale * float(np.sqrt(variance)), count)


@dataclass(frozen=True)
class RootMeanSquare(Measure):
    """Square root of the quotient of a sum of squares (numerator) and a count."""

    is_quotient = False

    def value(self, tally: Mapping[str, float]) -> MeasureValue:
        """The value for pooled tallies."""
        count = tally[self.denominator]
        if not count > 0:
            return MeasureValue(float("nan"), count, reason="never observed")
        return MeasureValue(self.scale * float(np.sqrt(tally[self.numerator] / count)), count)


@dataclass(frozen=True)
class Percentile(Measure):
    """Percentile of a distribution kept in bins `numerator[0]`, ...; linear within a bin.

    The denominator counts all observations; those above the last border count as being there.
    """

    is_quotient = False
    borders: tuple[float, ...] = ()
    share: float = 0.5

    def num_telling(self, tally: Mapping[str, float]) -> float:
        """Observations on the smaller side of it: a hundredth of 50 is half an observation."""
        return tally[self.denominator] * min(self.share, 1.0 - self.share)

    def tallies(self) -> tuple[str, ...]:
        """The tallies that it needs."""
        bins = tuple(f"{self.numerator}[{index}]" for index in range(len(self.borders) - 1))
        return (*bins, self.denominator)

    def value(self, tally: Mapping[str, float]) -> MeasureValue:
        """The value for pooled tallies."""
        counts = [tally[f"{self.numerator}[{index}]"] for index in range(len(self.borders) - 1)]
        total = tally[self.denominator]
        if not total > 0:
            return MeasureValue(float("nan"), total, reason="never observed")
        cumulated = np.concatenate([[0.0], np.cumsum(counts)]) / total
        if cumulated[-1] < self.share:
            return MeasureValue(
                float("nan"), total, reason=f"more than {1 - self.share:.0%} lie above {self.borders[-1]:g}"
            )
        # empty bins make the distribution flat: take the first place at which it reaches the share
        first = int(np.searchsorted(cumulated, self.share))
        low, high = cumulated[max(first - 1, 0)], cumulated[first]
        weight = 0.0 if high == low else (self.share - low) / (high - low)
        border = self.borders[max(first - 1, 0)] * (1 - weight) + self.borders[first] * weight
        return MeasureValue(self.scale * border, total)


@dataclass(frozen=True)
class RestrictedMean(Measure):
    """Mean of the lesser of a quantity and a limit, where some observations are censored.

    A censored observation is longer than what was seen of it. Left out, it would make the mean too small, the more so
    the fewer there are; so it stays in the life table as far as it was seen.

    Tallies: `numerator[k]` observations end in class k, `censored_classes[k]` are censored in it; the denominator
    counts all, those that reach the limit included.

    Source: actuarial life table, Cutler & Ederer (1958), J. Chronic Dis. 8: what is censored in a class is half at
        risk there; restricted mean, Royston & Parmar (2013), BMC Med. Res. Methodol. 13:152. Survival falls linearly
        within a class. Where nothing is left at risk, it stays as it is (Gill 1980).
    """

    is_quotient = False
    censored_classes: str = ""  # tallies of those censored in each class
    num_classes: int = 1  # number of classes
    class_width: float = 1.0  # width of each; the limit is where the last one ends

    def tallies(self) -> tuple[str, ...]:
        """The tallies that it needs."""
        classes = range(self.num_classes)
        ended = tuple(f"{self.numerator}[{index}]" for index in classes)
        return (*ended, *(f"{self.censored_classes}[{index}]" for index in classes), self.denominator, self.censored)

    def value(self, tally: Mapping[str, float]) -> MeasureValue:
        """The value for pooled tallies."""
        total, num_censored = tally[self.denominator], tally[self.censored]
        if not total > 0:
            return MeasureValue(float("nan"), total, num_censored, "never observed")
        at_risk, survival, mean = total, 1.0, 0.0
        for index in range(self.num_classes):
            ended, censored = tally[f"{self.numerator}[{index}]"], tally[f"{self.censored_classes}[{index}]"]
            exposed = at_risk - 0.5 * censored
            after = survival * (1.0 - ended / exposed) if exposed > 0 else survival
            mean += 0.5 * (survival + after) * self.class_width
            at_risk, survival = at_risk - ended - censored, after
        return MeasureValue(self.scale * mean, total, num_censored)
