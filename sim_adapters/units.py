"""The only conversions between the units of files and SI."""

from typing import TypeVar

import numpy as np

Quantity = TypeVar("Quantity", float, np.ndarray)
SECONDS_PER_HOUR = 3600.0
METRES_PER_KILOMETRE = 1000.0
KMH_PER_MPS = 3.6


def mps_from_kmh(speed_kmh: Quantity) -> Quantity:
    """Return a speed in m/s."""
    return speed_kmh / KMH_PER_MPS


def kmh_from_mps(speed_mps: Quantity) -> Quantity:
    """Return a speed in km/h."""
    return speed_mps * KMH_PER_MPS


def vehps_from_vehph(flow_vehph: Quantity) -> Quantity:
    """Return a flow in vehicles per second."""
    return flow_vehph / SECONDS_PER_HOUR


def vehph_from_vehps(flow_vehps: Quantity) -> Quantity:
    """Return a flow in vehicles per hour."""
    return flow_vehps * SECONDS_PER_HOUR


def vehpkm_from_vehpm(density_vehpm: Quantity) -> Quantity:
    """Return a density in vehicles per kilometre."""
    return density_vehpm * METRES_PER_KILOMETRE
