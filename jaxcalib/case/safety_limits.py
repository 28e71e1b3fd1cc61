"""From where on traffic counts as dangerous: the limits of the safety measures, which a case may state itself."""

from typing import Generic, NamedTuple, TypeVar

Value = TypeVar("Value")  # a number in a case, an array in a measure


class SafetyLimits(NamedTuple, Generic[Value]):
    """Limits of the safety measures.

    Sources: time to collision, Minderhoud & Bovy (2001), Accid. Anal. Prev. 33: drivers of vehicles without assistance;
    serious conflict, Hayward (1972), and the FHWA's surrogate safety assessment model (2008); deceleration to avoid a
    crash, Archer (2005), sec. 3.3.3; hard braking, below AASHTO's comfortable deceleration of 3.4 m/s^2, which most
    drivers never exceed; post-encroachment time, Allen, Shin & Cooper (1978), Transp. Res. Rec. 667. Urgent changes are
    this project's: 100 m are 4 s at 90 km/h.
    """

    ttc_s: Value  # time to collision below which a vehicle is exposed
    near_miss_ttc_s: Value  # and below which it nearly crashes, if it has to brake harder than `drac_mps2`, too
    drac_mps2: Value  # deceleration that avoids a crash
    full_braking_mps2: Value  # deceleration of a brake threat number of 1: dry road
    threat_number: Value  # brake threat number above which a vehicle is exposed
    hard_braking_mps2: Value  # deceleration above which a vehicle brakes hard
    encroachment_s: Value  # post-encroachment time below which a lane change is a conflict
    after_cut_in_s: Value  # how long after a cut-in the subject vehicle is watched
    urgent_way_m: Value  # way left to the end of a lane below which a change that the route asks for is urgent


USUAL_LIMITS: SafetyLimits[float] = SafetyLimits(
    ttc_s=3.0,
    near_miss_ttc_s=1.5,
    drac_mps2=3.35,
    full_braking_mps2=8.0,
    threat_number=0.5,
    hard_braking_mps2=3.0,
    encroachment_s=1.0,
    after_cut_in_s=3.0,
    urgent_way_m=100.0,
)
