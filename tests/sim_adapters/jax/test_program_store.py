"""Names of programs, and what a store does with good and with damaged files."""

import os
import sys
import uuid
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcalib.cli.compilation_cache import keep_compiled_programs
from sim_adapters.jax import program_store
from sim_adapters.jax.processor import processor
from sim_adapters.jax.program_store import ProgramStore, compile_afresh
from surrogate.loop.world import Clock
from surrogate.road.perception import Sensor

CLOCK = Clock(step_s=0.1, steps_per_decision=10)
SHAPES = (jax.ShapeDtypeStruct((3,), jnp.float32),)


class FromElsewhere:
    pass


def sensor(ahead_m: float) -> Sensor:
    return Sensor(jnp.asarray(ahead_m), jnp.asarray(90.0), 8)


def compiled() -> jax.stages.Compiled:
    own = uuid.uuid4().int % 2**31  # no cache holds this one
    program, is_fresh = compile_afresh(jax.jit(lambda x: (jnp.sin(x) / 3.0, jnp.sum(x) + 0 * own)).lower(*SHAPES), {})
    assert is_fresh
    return program


def test_equal_ingredients_have_one_name_and_each_difference_another(tmp_path: Path) -> None:
    store = ProgramStore(tmp_path)
    variants = [
        (CLOCK, sensor(120.0), 64),
        (CLOCK, sensor(120.0), 96),
        (CLOCK, sensor(121.0), 64),
        (Clock(step_s=0.2, steps_per_decision=10), sensor(120.0), 64),
        (CLOCK, np.arange(5000), 64),
        (CLOCK, np.where(np.arange(5000) == 2500, -1, np.arange(5000)), 64),  # printed, both look alike
    ]
    names = [store.key(variant) for variant in variants]
    assert None not in names
    assert len(set(names)) == len(variants)
    assert store.key((Clock(step_s=0.1, steps_per_decision=10), sensor(120.0), 64)) == names[0]


def test_what_cannot_be_told_apart_has_no_name(tmp_path: Path) -> None:
    store = ProgramStore(tmp_path)
    assert store.key((CLOCK, lambda x: x)) is None  # cannot be pickled
    assert store.key((CLOCK, FromElsewhere())) is None  # its source is not looked at


def test_settings_and_sources_belong_to_the_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = ProgramStore(tmp_path)
    before = store.key((CLOCK,))
    with jax.numpy_dtype_promotion("standard"):
        assert store.key((CLOCK,)) == before
    monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", "") + " --xla_cpu_enable_fast_math=true")
    flagged = store.key((CLOCK,))
    monkeypatch.setattr(program_store, "_sources", lambda: "others")
    assert len({before, flagged, store.key((CLOCK,))}) == 3


def test_a_kept_program_gives_the_same_bits(tmp_path: Path) -> None:
    store = ProgramStore(tmp_path / "made" / "when needed")
    key = store.key((CLOCK, 1)) or ""
    assert store.load(key, SHAPES, (0, 0)) is None
    program = compiled()
    store.save(key, program)
    again = store.load(key, SHAPES, (0, 0))
    assert again is not None
    x = jnp.asarray([0.3, -1.7, 40.0], jnp.float32)
    for one, other in zip(program(x), again(x), strict=True):
        assert np.asarray(one).tobytes() == np.asarray(other).tobytes()


@pytest.mark.parametrize("content", [b"", b"nothing that was compressed"])
def test_a_damaged_file_counts_as_none(tmp_path: Path, content: bytes) -> None:
    store = ProgramStore(tmp_path)
    key = store.key((CLOCK, 2)) or ""
    store.save(key, compiled())
    file = next(tmp_path.iterdir())
    whole = file.read_bytes()
    file.write_bytes(content or whole[: len(whole) // 2])  # as a full disk leaves it
    assert store.load(key, SHAPES, (0, 0)) is None
    store.save(key, compiled())
    assert store.load(key, SHAPES, (0, 0)) is not None


def test_the_least_recently_used_programs_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(program_store, "MOST_PROGRAMS", 2)
    store = ProgramStore(tmp_path)
    program = compiled()
    for age, name in ((30.0, "a"), (20.0, "b")):
        store.save(name, program)
        os.utime(tmp_path / f"{name}.program", (1e9 - age, 1e9 - age))
    assert store.load("a", SHAPES, (0, 0)) is not None  # used just now
    store.save("c", program)
    assert sorted(file.stem for file in tmp_path.iterdir()) == ["a", "c"]


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    ProgramStore(tmp_path / "file" / "below").save("a", compiled())
    assert ProgramStore(tmp_path / "file" / "below").load("a", SHAPES, (0, 0)) is None


@pytest.fixture
def before_jax(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    for name in [name for name in os.environ if name.startswith(("JAX_", "JAXCALIB_"))]:
        monkeypatch.delenv(name)
    # set, so that what the function sets is taken back
    for name in ("DIR", "MAX_SIZE"):
        monkeypatch.setenv(f"JAX_COMPILATION_CACHE_{name}", "")
        monkeypatch.delenv(f"JAX_COMPILATION_CACHE_{name}")
    monkeypatch.setenv("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "1.5")
    monkeypatch.delitem(sys.modules, "jax")
    return monkeypatch


def test_the_folder_is_one_per_processor_and_version(before_jax: pytest.MonkeyPatch, tmp_path: Path) -> None:
    before_jax.setenv("JAXCALIB_CACHE", str(tmp_path / "here"))
    folder = keep_compiled_programs()
    assert folder == tmp_path / "here" / f"{processor()}-jax-{jax.__version__}"
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == str(folder)
    assert os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] == "1.5"  # the user's
    assert folder.stat().st_mode & 0o077 == 0


def test_it_can_be_turned_off_and_gives_way_to_jax_s_own_variable(
    before_jax: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    before_jax.setenv("JAXCALIB_CACHE", "off")
    assert keep_compiled_programs() is None
    before_jax.setenv("JAXCALIB_CACHE", str(tmp_path))
    before_jax.setenv("JAX_COMPILATION_CACHE_DIR", "/elsewhere")
    assert keep_compiled_programs() is None
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == "/elsewhere"
    before_jax.delenv("JAX_COMPILATION_CACHE_DIR")
    before_jax.setitem(sys.modules, "jax", jax)
    assert keep_compiled_programs() is None
