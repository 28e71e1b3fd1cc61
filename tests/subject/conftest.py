"""A straight road of a few lanes, vehicles on it, and the subject vehicle's planner in closed loop."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))  # for straight_road
