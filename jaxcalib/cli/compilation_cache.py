"""Where compiled programs are kept between runs of the command line."""

import importlib.metadata
import os
import sys
from pathlib import Path

from platformdirs import user_cache_path

from sim_adapters.jax.processor import processor

VARIABLE = "JAXCALIB_CACHE"
OFF = "off"
LEAST_COMPILE_S = 0.2  # what compiles faster is not worth a file
MOST_BYTES = 1 << 30


def keep_compiled_programs() -> Path | None:
    """Turn on JAX's persistent cache for this process and those that it starts; call it before JAX is imported.

    The environment variable JAXCALIB_CACHE names another folder, or is `off`. JAX's own variable
    JAX_COMPILATION_CACHE_DIR goes before it.

    Returns:
        The folder; None where programs are not kept: turned off, JAX is imported already, or no folder can be made.
    """
    chosen = os.environ.get(VARIABLE, "")
    if "JAX_COMPILATION_CACHE_DIR" in os.environ or chosen.lower() == OFF or "jax" in sys.modules:
        return None
    base = Path(chosen).expanduser() if chosen else user_cache_path("jaxcalib")
    # machine code for one kind of processor need not run on another, and homes are shared between machines
    folder = base.absolute() / f"{processor()}-jax-{importlib.metadata.version('jax')}"
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError:
        return None
    if not os.access(folder, os.W_OK):
        return None
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", str(LEAST_COMPILE_S))
    # a limit also makes JAX lock the folder, so that nobody reads what another is still writing
    os.environ.setdefault("JAX_COMPILATION_CACHE_MAX_SIZE", str(MOST_BYTES))
    return folder
