"""A process that answers a question as it is told to, or hangs."""

import json
import sys
import time

from sim_adapters.sumo.question import ANSWER

if __name__ == "__main__":
    asked = json.load(sys.stdin)
    if "hangs_s" in asked:
        time.sleep(asked["hangs_s"])
    sys.stdout.buffer.write(b"\xff\xfe is no UTF-8\n")
    if "says" in asked:
        print(f"{ANSWER}{asked['says']}")
