"""Which kind of processor this is, for machine code that runs on one kind only."""

import hashlib
import platform
from pathlib import Path

# of Linux's list; what differs from moment to moment, as clock rates, is left out
TOLD = {"flags", "features", "vendor_id", "cpu family", "model", "stepping", "cpu implementer", "cpu part"}


def processor() -> str:
    """Return a short digest of the processor's kind and features."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        kinds = sorted({line for line in lines if line.partition(":")[0].strip().lower() in TOLD})
    except OSError:  # no Linux: the machine itself stands for its kind
        kinds = [platform.processor(), platform.node(), platform.version()]
    return hashlib.sha256("\n".join([platform.machine(), *kinds]).encode()).hexdigest()[:16]
