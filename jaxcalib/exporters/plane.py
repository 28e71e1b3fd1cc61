"""Where a network's plane lies on the globe."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Plane:
    """A network's plane."""

    projection: str | None  # as PROJ writes it; None where the network has none
    net_offset_m: tuple[float, float]  # added to projected coordinates to get those of the network
