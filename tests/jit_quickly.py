"""Programs that tests make to run them a few times: they are made in a third of the time, and take twice as long.

What they compute is the same but for rounding. Where bits count, tests take programs as simulators make them.
"""

from collections.abc import Callable
from typing import Any

import jax
import pytest

from jaxcalib.problem import engines
from sim_adapters.jax import batch_program
from surrogate.xla.materialise import FOR_PROCESSORS

QUICKLY = FOR_PROCESSORS | {"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False}


def jit_quickly(function: Callable[..., Any], **how: Any) -> Any:
    """Return the compiled function; for what else can be said see `jax.jit`."""
    return jax.jit(function, compiler_options=QUICKLY, **how)


def make_engines_quickly(patch: pytest.MonkeyPatch) -> None:
    """Let engines take such programs; nobody else finds them, for a kept program's name does not tell them apart."""
    patch.setattr(batch_program, "compiler_options", lambda: QUICKLY)
    patch.setattr(engines, "program_store", lambda: None)
