"""Keeps values that many others are made of from being computed many times.

XLA's compiler for processors gives each array that it writes a loop of its own and puts everything that the array
depends on into that loop, so what two arrays share is computed twice. In a decision about lanes that came to seven
times the operations (1251 multiplications per vehicle instead of 179). `materialise` marks where it must not.
"""

from typing import Any, TypeVar

import jax

Tree = TypeVar("Tree")

# The first pass drops the marks before loops are fused. The second hands halves of a loop to a pool of threads, which
# costs a tenth of the time where each core has runs of its own. The third has a small `while` written as one function
# by an emitter that knows no marks: XLA then ends the process ("shape.h ... Check failed: buffer != nullptr"). Small is
# what touches less than 1024 bytes before jaxlib 0.12.0, and less than 1e9 bytes, thus any loop here, since.
# XLA prefers vectors of 256 bits, which takes a tenth longer on a processor with 512; one without splits them.
PASSES_LEFT_OUT = ("cse_barrier_expander", "cpu-parallel-task-assigner", "small-while-loop-hoisting")
FOR_PROCESSORS: dict[str, Any] = {
    "xla_disable_hlo_passes": ",".join(PASSES_LEFT_OUT),
    "xla_cpu_prefer_vector_width": 512,
}


def on_processors() -> bool:
    """Return whether JAX computes on processors, not on an accelerator, by default."""
    return jax.default_backend() == "cpu"


def compiler_options() -> dict[str, Any]:
    """Return what to compile programs with that have such marks."""
    return FOR_PROCESSORS if on_processors() else {}


def materialise(values: Tree) -> Tree:
    """Return the values, which the compiler writes to memory once instead of computing them wherever they are used.

    Does nothing on accelerators, where what is computed again is cheaper than what is written and read: without marks,
    2048 runs of 1600 places took 4.3 instead of 5.0 ms per simulated second on an H200.
    """
    return jax.lax.optimization_barrier(values) if on_processors() else values
