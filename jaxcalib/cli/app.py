"""The command line."""

import sys

from cyclopts import App

from jaxcalib.cli.bring_in import check, import_, new
from jaxcalib.cli.compilation_cache import keep_compiled_programs
from jaxcalib.cli.drivers import effects, fit_following
from jaxcalib.cli.find_and_judge import calibrate, diagnose, sweep, validate
from jaxcalib.cli.hand_over import dossier, export
from jaxcalib.cli.interrupts import end_wherever_interrupted

app = App(name="jaxcalib", help="Calibrate SUMO traffic around automated vehicles from their logs.")
app.command(import_, name="import")
for command in (new, check, calibrate, diagnose, effects, fit_following, sweep, validate, dossier, export):
    app.command(command)


def main() -> None:
    """Run the command line."""
    end_wherever_interrupted()
    keep_compiled_programs()
    sys.exit(app())
