"""Takes note of each internet socket that a Python process makes, binds or connects; loaded at its start.

Put the folder first in PYTHONPATH and name the file in FAULTS_SOCKETS.
"""

import os
import socket
import sys

_FILE = os.environ.get("FAULTS_SOCKETS")
_INTERNET = {socket.AF_INET, socket.AF_INET6}


def _note(event: str, arguments: tuple) -> None:
    if (event == "socket.__new__" and arguments[1] in _INTERNET) or (
        event in ("socket.bind", "socket.connect") and isinstance(arguments[1], tuple)
    ):
        what = f"{event} {arguments[1]}"
    else:
        return
    assert _FILE is not None
    with open(_FILE, "a", encoding="utf-8") as file:
        file.write(f"{what} by {sys.argv[:4]}\n")


if _FILE:
    sys.addaudithook(_note)
