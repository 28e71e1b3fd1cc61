"""Programs of tests' own: with marks of `materialise`, without the passes that drop them or fail on them."""

from collections.abc import Callable
from typing import Any

import jax

from surrogate.xla.materialise import FOR_PROCESSORS

# As the compiler does unless it is told otherwise, which tests tell it (`tests/conftest.py`).
AS_USERS_DO = {"xla_backend_optimization_level": 3, "xla_cpu_use_fusion_emitters": True}


def jit_as_users_do(function: Callable[..., Any]) -> Any:
    """Return the compiled function as a user's process makes it, for tests that compare bits."""
    return jax.jit(function, compiler_options=FOR_PROCESSORS | AS_USERS_DO)


def jit_marked(function: Callable[..., Any], **how: Any) -> Any:
    """Return the compiled function; for what else can be said see `jax.jit`."""
    return jax.jit(function, compiler_options=FOR_PROCESSORS, **how)
