"""Compiling a parallel loop once: Numba's own wraps of it are linked, not compiled on their own.

Numba puts the body of a loop over `prange` into a library, that into a second one for its calling
convention, this into a third for threads, and all into the kernel's; each is optimised and
assembled with all that is in it. Nothing ever calls the second and the third but by way of the
kernel. Without them LLVM has half as much to do for a parallel kernel. The body has to be optimised
on its own: in the process that compiles it the kernel's copy gives way to it.

All this is private to Numba: with other versions than those it was tried with all is compiled as
usual.
"""

from typing import Any

from numba import __version__
from numba.core import codegen
from numba.core.registry import cpu_target

TRIED = ("0.68.",)
# What Numba calls those libraries.
WRAPS = ("<numba.np.ufunc.wrappers._GufuncWrapper", "parallelgufuncwrapper")
_Library: Any = getattr(codegen, "JITCodeLibrary", object)


class LinkedLibrary(_Library):  # type: ignore[misc]
    """A library; where it only wraps a loop it is compiled with the kernel that it is linked to."""

    _as_usual = False

    @property
    def _wraps(self) -> bool:
        return not self._as_usual and str(self.name).startswith(WRAPS)

    def _optimize_final_module(self) -> None:
        if not self._wraps:
            super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        if self._wraps:
            self._finalized = True
        else:
            super()._finalize_final_module()

    def get_pointer_to_function(self, name: str) -> Any:
        """Compile it after all, if somebody wants to call it."""
        self._ensure_finalized()
        if self._wraps:
            self._as_usual = True
            self._optimize_final_module()
            self._finalize_final_module()
        return super().get_pointer_to_function(name)


def _codegen() -> Any:
    try:
        return cpu_target.target_context.codegen()
    except AttributeError:
        return None


def link_wraps() -> None:
    """From now on only link what wraps a loop; the caller holds Numba's lock."""
    if not __version__.startswith(TRIED):
        return
    made_by = _codegen()
    if getattr(made_by, "_library_class", None) is _Library:
        made_by._library_class = LinkedLibrary


def compile_wraps() -> None:
    """From now on compile it, for others in this process."""
    made_by = _codegen()
    if getattr(made_by, "_library_class", None) is LinkedLibrary:
        del made_by._library_class
