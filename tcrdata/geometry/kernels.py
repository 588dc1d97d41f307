"""Kernels: loops over arrays, compiled when one is first called and cached on disk.

Numba looks for changes in a kernel's own file alone: after editing a kernel that other files call,
delete `__pycache__/*.nbi` beside them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, cached_property, update_wrapper
from typing import Any, TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., Any])


class Kernel:
    """A function that numba compiles at its first call: a process that calls none never loads it.

    A kernel may call others, which are compiled with it.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        """Compile nothing yet.

        Args:
            function: of scalars and arrays.
            options: of `numba.njit`.
        """
        self._function = function
        self._options = options
        update_wrapper(self, function)

    @cached_property
    def dispatcher(self) -> Any:
        """What numba makes of the function."""
        return _numba().njit(cache=True, **self._options)(self._function)

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function."""
        return self.dispatcher(*arguments)


def kernel(**options: Any) -> Callable[[Function], Function]:
    """Return a decorator that makes kernels with these options of `numba.njit`."""

    def decorate(function: Function) -> Function:
        return cast(Function, Kernel(function, options))

    return decorate


# Without the interpreter's lock; without Python's checks for division by zero loops become vector
# instructions.
compiled = kernel(nogil=True, error_model="numpy")
"""For all loops but those that `reordered` may take."""

reordered = kernel(nogil=True, error_model="numpy", fastmath=True)
"""The same; sums may be taken in another order, several numbers at once. Knows no NaN."""


@cache
def _numba() -> Any:
    """Return numba, told that a kernel within another stands for what is compiled of it."""
    import numba
    from numba.core.registry import cpu_target
    from numba.extending import typeof_impl

    with _without_blas():
        cpu_target.typing_context.refresh()
        cpu_target.target_context.refresh()

    @typeof_impl.register(Kernel)  # type: ignore[untyped-decorator]
    def _type_of(value: Kernel, _: Any) -> Any:
        return numba.types.Dispatcher(value.dispatcher)

    return numba


@contextmanager
def _without_blas() -> Iterator[None]:
    """Let numba find no BLAS as it sets itself up: no kernel asks for one.

    Looking for it imports scipy.linalg, which takes as long as setting up all the rest.
    """
    name = "scipy.linalg.cython_blas"
    if name in sys.modules:
        yield
        return
    sys.modules[name] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        del sys.modules[name]
