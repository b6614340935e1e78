"""Compiling each kernel once: what only it calls is linked to it, not compiled on its own.

Numba optimises and assembles every function that a kernel calls in a library of its own, with all
that is in it, and once more in the kernel. Nothing but kernels calls helpers, and what NumPy's
functions become inside them: these libraries are only linked, a tenth of a first call's time less.

The same is so for loops over `prange`. Numba puts the body into a library, that into a second one
for its calling convention, this into a third for threads, and all into the kernel's. Nothing ever
calls the second and the third but by way of the kernel. The body has to be optimised on its own: in
the process that compiles it the kernel's copy gives way to it.

All this is private to Numba: with other versions than those it was tried with all is compiled as
usual.
"""

from typing import Any

from numba import __version__
from numba.core import codegen
from numba.core.registry import cpu_target

from qsmooth.kernels.compiling import inside_another

TRIED = ("0.68.",)
# What Numba calls the libraries that wrap a loop.
WRAPS = ("<numba.np.ufunc.wrappers._GufuncWrapper", "parallelgufuncwrapper")
_Library: Any = getattr(codegen, "JITCodeLibrary", object)


class LinkedLibrary(_Library):  # type: ignore[misc]
    """A library; where only kernels call it, it is compiled with those that it is linked to."""

    def __init__(self, made_by: Any, name: str) -> None:
        super().__init__(made_by, name)
        self._only_linked = inside_another() or name.startswith(WRAPS)

    @property
    def codegen(self) -> Any:
        """What made it; where it is only linked, there is no address to set its environment at."""
        made_by = super().codegen
        return _NoEnvironment(made_by) if self._only_linked else made_by

    def _optimize_final_module(self) -> None:
        if not self._only_linked:
            super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        if self._only_linked:
            self._finalized = True
        else:
            super()._finalize_final_module()

    def get_pointer_to_function(self, name: str) -> Any:
        """Compile it after all, if it has this function: somebody wants to call it."""
        self._ensure_finalized()
        if self._only_linked:
            if not self._defines(name):
                return 0
            self._only_linked = False
            self._optimize_final_module()
            self._finalize_final_module()
        return super().get_pointer_to_function(name)

    def _defines(self, name: str) -> bool:
        return any(f.name == name and not f.is_declaration for f in self._final_module.functions)


class _NoEnvironment:
    """What makes libraries, but for setting environments of functions."""

    def __init__(self, made_by: Any) -> None:
        self._made_by = made_by

    def __getattr__(self, name: str) -> Any:
        return getattr(self._made_by, name)

    def set_env(self, name: str, env: Any) -> None:
        """Set nothing."""


def _codegen() -> Any:
    try:
        return cpu_target.target_context.codegen()
    except AttributeError:
        return None


def begin_linking() -> None:
    """From now on only link what kernels alone call; the caller holds Numba's lock."""
    if not __version__.startswith(TRIED):
        return
    made_by = _codegen()
    if getattr(made_by, "_library_class", None) is _Library:
        made_by._library_class = LinkedLibrary


def end_linking() -> None:
    """From now on compile all on its own, for others in this process."""
    made_by = _codegen()
    if getattr(made_by, "_library_class", None) is LinkedLibrary:
        del made_by._library_class
