"""SUMO's network as ASAM OpenDRIVE, by netconvert."""

import subprocess
from pathlib import Path

import sumolib

from sim_adapters.errors import ScenarioError

WRITTEN_AS, HOLDS = 'revMajor="1" revMinor="4"', 'revMajor="1" revMinor="5"'


def write_open_drive(network: Path, file: Path) -> bool:
    """Write a network's road; its plane is the network's, which netconvert does not move.

    netconvert says that it writes 1.4, but its header has an offset, from this plane to projected places, which is
    there from 1.5 on; so that is what the file says here, and the schema of 1.5 is what it keeps to.

    Source: ASAM OpenDRIVE 1.5, header.

    Args:
        network: SUMO's network (.net.xml, packed or not).
        file: where to; ends in .xodr.

    Returns:
        Whether it was written: False where netconvert is not installed.

    Raises:
        ScenarioError: netconvert refuses the network, in its words.
    """
    command = [
        sumolib.checkBinary("netconvert"), "-s", network.name, "--offset.disable-normalization", "true",
        "--opendrive-output", str(file.absolute()),
        "--opendrive-output.lefthand-left", "true",  # else junctions of a left-hand network lie beside its lanes
    ]  # fmt: skip
    try:
        done = subprocess.run(command, cwd=network.parent, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return False
    if done.returncode or not file.is_file():
        said = (done.stderr + done.stdout).strip().splitlines() or [f"it ends with code {done.returncode}."]
        raise ScenarioError(network, f"netconvert makes no OpenDRIVE of it: {said[0].removeprefix('Error: ')}")
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace(WRITTEN_AS, HOLDS, 1), encoding="utf-8")
    return True
