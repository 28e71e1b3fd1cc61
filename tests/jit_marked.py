"""Programs of functions with marks of `materialise`, made without the passes that drop them or fail on them."""

from collections.abc import Callable
from typing import Any

import jax

from surrogate.xla.materialise import FOR_PROCESSORS


def jit_marked(function: Callable[..., Any], **how: Any) -> Any:
    """Return the compiled function; for what else can be said see `jax.jit`."""
    return jax.jit(function, compiler_options=FOR_PROCESSORS, **how)
