"""One source, two speeds: kernels run as they are, or compiled by numba over a recording.

A kernel is a plain function on floats and tuples. `compiled` makes a twin of it in which it and
every kernel it calls are compiled; without numba the twin is the kernel itself. Nodes never come
here, so they start without numba.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import math
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

PACKAGE = __name__.partition(".")[0]


@functools.cache
def _numba() -> ModuleType | None:
    """Numba, with its cache in a folder that changes with the sources, or None."""
    if importlib.util.find_spec("numba") is None:
        return None
    sources = sorted(Path(__file__).parents[1].rglob("*.py"))
    key = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()[:16]
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    folder = os.path.join(home, PACKAGE, key)
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError:
        folder = tempfile.mkdtemp(prefix=PACKAGE)
    os.environ.setdefault("NUMBA_CACHE_DIR", folder)
    import numba

    return numba


@functools.cache
def compiled(kernel: Callable[..., Any], **bindings: Callable[..., Any]) -> Callable[..., Any]:
    """The kernel, compiled with all kernels it calls; ``bindings`` replace names it uses."""
    numba = _numba()
    names: dict[str, Any] = dict(bindings)
    twin_globals = dict(kernel.__globals__)
    for name in kernel.__code__.co_names:
        value = names.get(name, twin_globals.get(name))
        if isinstance(value, FunctionType) and value.__module__.startswith(PACKAGE + "."):
            names[name] = compiled(value)
    if numba is None and not bindings:
        return kernel
    twin_globals.update(names)
    twin = FunctionType(kernel.__code__, twin_globals, kernel.__name__, kernel.__defaults__)
    twin.__module__ = kernel.__module__
    twin.__qualname__ = "_of_".join(
        [kernel.__qualname__, *(f"{b.__module__}.{b.__qualname__}" for b in bindings.values())]
    ).replace(".", "_")
    return numba.njit(twin, cache=True, nogil=True) if numba is not None else twin


def run_steps(step: Callable[..., Any]) -> Callable[..., Any]:
    """The loop of a filter's ``step(state, gains, gyro, accel, mag, dt)`` over a recording."""
    return compiled(_run, step=step)


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
