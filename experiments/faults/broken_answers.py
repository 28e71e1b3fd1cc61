"""The process that SUMO's questions are put to, where it answers wrongly: reads how on standard input."""

import json
import os
import signal
import sys
import time

from sim_adapters.sumo.question import ANSWER

ANSWERS = {
    "no JSON": "{not JSON",
    "a number": "5",
    "a list": "[1, 2]",
    "other keys": '{"a": 1}',
    "other types": '{"vtypes": 5, "ways": {}, "reached_s": "x", "is_whole": [], "entered_s": "y", "arrived_s": {}, '
    '"edge": 1, "waiting": 7}',
    "no finite numbers": '{"vtypes": {"car": {"length": NaN}}, "ways": [], "reached_s": NaN, "is_whole": true, '
    '"entered_s": NaN, "arrived_s": NaN, "edge": "", "waiting": []}',
}
WITHOUT_WORDS = ("segfault", "hang", "silence", "noise")
HOW = (*WITHOUT_WORDS, *ANSWERS)


def main() -> None:
    """Answer wrongly."""
    how = json.load(sys.stdin)["how"]
    if how == "segfault":
        os.kill(os.getpid(), signal.SIGSEGV)
    while how == "hang":
        time.sleep(1.0)
    if how == "noise":
        sys.stdout.buffer.write(os.urandom(5000))
    if how in ANSWERS:
        print(f"\n{ANSWER}{ANSWERS[how]}")


if __name__ == "__main__":
    main()
