"""Where tests find what they read: the repository, its corridor, and the shared folder that may lie beside it."""

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CORRIDOR = ROOT / "experiments/cases/corridor"
SHARED = Path(os.environ.get("JAXCALIB_SHARED", ROOT.parent / "shared"))  # not part of the repository
SHARED_CASES, SHARED_DATA = SHARED / "cases", SHARED / "data"
