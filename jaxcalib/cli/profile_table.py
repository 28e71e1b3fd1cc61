"""Where a command's time went, as a table on standard error."""

from rich.console import Console
from rich.table import Table

from jaxcalib.runs.profile import profile


def print_profile(console: Console | None = None) -> None:
    """Print where the time has gone by now; nothing where nobody asked for it."""
    told = profile()
    if told is None:
        return
    here, beside = told["this_thread_s"], told["other_threads_s"]
    table = Table(title="where the time went", title_justify="left")
    for name in ("", "this thread, s", "other threads, s", "processor time, s"):
        table.add_column(name, justify="left" if not name else "right")
    for kind, seconds in here.items():
        table.add_row(kind, f"{seconds:.1f}", f"{beside[kind]:.1f}" if kind in beside else "", "")
    table.add_section()
    table.add_row("this process", f"{told['wall_s']:.1f}", "", f"{told['process_cpu_s']:.1f}")
    table.add_row("SUMO's processes", "", "", f"{told['sumo_cpu_s']:.1f}")
    printed = console or Console(stderr=True)
    printed.print(table)
    cores = "the core's time" if told["cores"] == 1 else f"the time of {told['cores']} cores"
    printed.print(f"used: {told['used_share']:.0%} of {cores}", highlight=False)
