"""Programs that tests make to run them a few times: they are made in a third of the time, and take twice as long.

What they compute is the same but for rounding. Where bits count, tests take programs as simulators make them.
"""

from collections.abc import Callable
from typing import Any

import jax

from surrogate.xla.materialise import FOR_PROCESSORS

QUICKLY = FOR_PROCESSORS | {"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False}


def jit_quickly(function: Callable[..., Any], **how: Any) -> Any:
    """Return the compiled function; for what else can be said see `jax.jit`."""
    return jax.jit(function, compiler_options=QUICKLY, **how)
