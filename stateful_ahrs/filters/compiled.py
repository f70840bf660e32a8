"""One source, two speeds: kernels run as they are, or compiled by numba over a recording.

A kernel is a plain function on floats and tuples. `compiled` makes a twin of it in which it and
every kernel it calls are compiled; without numba the twin is the kernel itself. Nodes compile
nothing, so they start without numba. `bind` makes a twin that calls other kernels than its source
names, so that one step serves a family of filters.
"""

from __future__ import annotations

import functools
import importlib.util
import math
import os
from collections.abc import Callable
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

PACKAGE = __name__.partition(".")[0]
LONGEST = 150  # letters: names become names of files in numba's cache


@functools.cache
def _numba() -> ModuleType | None:
    """Numba, with its cache in a folder that changes with the kernels, or None.

    Numba itself sees when a kernel's own file changes, but not those of the kernels it calls.
    """
    if importlib.util.find_spec("numba") is None:
        return None
    import hashlib  # not above: nodes, which compile nothing, would wait for them at every start
    import tempfile

    package = Path(__file__).parents[1]
    rooms = (package / "snapshot", package / "filters")
    sources = [package / "rotor.py", *sorted(path for room in rooms for path in room.glob("*.py"))]
    key = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()[:16]
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    folder = os.path.join(chosen or os.path.join(home, PACKAGE), key)
    if chosen and os.path.basename(chosen) == key:  # by the process that started this one
        folder = chosen
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError:
        folder = tempfile.mkdtemp(prefix=PACKAGE)
    os.environ["NUMBA_CACHE_DIR"] = folder
    import numba

    return numba


def cold() -> bool:
    """Whether kernels will have to be compiled, because none was since they last changed."""
    return _numba() is not None and not any(Path(os.environ["NUMBA_CACHE_DIR"]).iterdir())


@functools.cache
def bind(kernel: Callable[..., Any], **kernels: Callable[..., Any]) -> Callable[..., Any]:
    """A twin of the kernel that calls these where its source says their names."""
    bound = (f"{k.__module__.rpartition('.')[2]}_{k.__qualname__}" for k in kernels.values())
    name = "_of_".join([kernel.__qualname__, *bound])
    if len(name) > LONGEST:
        import hashlib  # as above: only what compiles has need of it

        name = f"{kernel.__qualname__}_of_{hashlib.sha256(name.encode()).hexdigest()[:16]}"
    return twin(kernel, kernels, name)


@functools.cache
def compiled(
    kernel: Callable[..., Any], inline: bool = False, fused: bool = False, use: str = ""
) -> Callable[..., Any]:
    """The kernel, compiled with all kernels it calls; the kernel itself without numba.

    ``inline`` makes one function of all, so that tuples stay in registers. It runs up to twice as
    fast, and where kernels are long it takes minutes to compile. ``fused`` lets a product and a sum
    be one operation with one rounding: a fifth faster, and 1e-16 off what plain Python makes.
    Numba links what it compiled first, so what is compiled otherwise has a ``use`` to tell it by.
    """
    numba = _numba()
    if numba is None:
        return kernel
    called = {
        name: compiled(value, inline, fused, use) for name, value in kernels_of(kernel).items()
    }
    with_compiled = twin(
        kernel, called, kernel.__qualname__ + "_inline" * inline + "_fused" * fused + use
    )
    return _jit(numba, inline, fused)(with_compiled)  # type: ignore[no-any-return]


def packed(kernel: Callable[..., Any], *like: Any) -> Callable[..., Any]:
    """The kernel as one function, compiled now and for arguments like these.

    What it does alike to neighbours in an array becomes one operation on all of them: half the time
    of what works on matrices, but what works on tuples it slows down, so numba leaves it alone.
    """
    numba = _numba()
    if numba is None or numba.config.DISABLE_JIT:
        return kernel
    # Its own twins of what it calls: else what is compiled first would decide how all is.
    called = {
        name: compiled(value, True, True, "_packed") for name, value in kernels_of(kernel).items()
    }
    one = _jit(numba, False, True)(twin(kernel, called, kernel.__qualname__ + "_packed"))
    usual = numba.config.SLP_VECTORIZE
    numba.config.SLP_VECTORIZE = 1
    try:
        one.compile(tuple(numba.typeof(each) for each in like))
    finally:
        numba.config.SLP_VECTORIZE = usual
    return one  # type: ignore[no-any-return]


def _jit(numba: Any, inline: bool, fused: bool) -> Any:
    # Kernels divide by nothing that can be zero, so numba need not look.
    return numba.njit(
        cache=True,
        nogil=True,
        error_model="numpy",
        forceinline=inline,
        fastmath={"contract"} if fused else False,
    )


def kernels_of(kernel: Callable[..., Any]) -> dict[str, FunctionType]:
    """The kernels that a kernel calls, by the names they have in it."""
    return {
        name: value
        for name in kernel.__code__.co_names
        if isinstance(value := kernel.__globals__.get(name), FunctionType)
        and value.__module__.startswith(PACKAGE + ".")
    }


def twin(kernel: Callable[..., Any], names: dict[str, Any], qualname: str) -> FunctionType:
    """The kernel's code, with other things behind some of its names."""
    names = {**kernel.__globals__, **names}
    other = FunctionType(kernel.__code__, names, kernel.__name__, kernel.__defaults__)
    other.__module__ = kernel.__module__
    other.__qualname__ = qualname  # by which numba's cache tells twins apart
    return other


def run_steps(step: Callable[..., Any], fused: bool = False) -> Callable[..., Any]:
    """The loop of a filter's ``step(state, gains, gyro, accel, mag, dt)`` over a recording."""
    return compiled(bind(_run, step=step), inline=True, fused=fused)


def step(*_: Any) -> Any:
    """Stands for a filter's own, which `run_steps` binds."""
    raise NotImplementedError


def _run(state: Any, gains: Any, gyro: Any, accel: Any, mag: Any, steps: Any, rotors: Any) -> Any:
    """Fill ``rotors`` (n, 4) with unit rotors; a step of NaN repeats the last (skipped)."""
    for i in range(len(steps)):
        if steps[i] == steps[i]:
            state = step(
                state,
                gains,
                (gyro[i, 0], gyro[i, 1], gyro[i, 2]),
                (accel[i, 0], accel[i, 1], accel[i, 2]),
                (mag[i, 0], mag[i, 1], mag[i, 2]),
                steps[i],
            )
        w, x, y, z = state.rotor
        s = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
        rotors[i, 0] = s * w
        rotors[i, 1] = s * x
        rotors[i, 2] = s * y
        rotors[i, 3] = s * z
    return state
