"""Make 2D quadrilateral, triangle and mixed meshes better by moving vertices.

Public names are loaded when first used: importing the package costs next to nothing. They are
listed in ``__init__.pyi``, which type checkers read, and nowhere else.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, _, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]


def __dir__() -> list[str]:
    return __all__.copy()
