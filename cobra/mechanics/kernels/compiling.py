"""How the kernels are compiled, and where the result is kept."""

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba

_FOLDER = Path(__file__).parent
FASTMATH = frozenset({"contract", "reassoc", "arcp", "nsz"})
"""Without "nnan" and "ninf": the sanity check of every step must still see what is not finite."""


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile at the first call, and keep the result on disk where there is a writable place for it.

    Names with an underscore are called from other kernels only and get no wrapper for Python, which would double the
    time to compile.
    """
    options: dict[str, Any] = {"fastmath": set(FASTMATH), "error_model": "numpy"}
    if function.__name__.startswith("_"):
        options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    config: Any = numba.config
    chosen = config.CACHE_DIR
    config.CACHE_DIR = str(Path(chosen or _FOLDER / "__pycache__") / f"kernels-{_fingerprint()}")
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # numba: "no locator available", neither that folder nor numba's own can be written
        return numba.njit(**options)(function)
    finally:
        config.CACHE_DIR = chosen


@cache
def _fingerprint() -> str:
    """Of all kernels together: numba notices a change only in the file of the function it has cached, not in those that
    this one calls. So each state of the kernels has a folder of its own."""
    digest = hashlib.sha256()
    for path in sorted(_FOLDER.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]
