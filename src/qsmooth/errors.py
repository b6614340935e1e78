"""What qsmooth raises and warns with."""


class MeshError(ValueError):
    """A mesh, or a mesh file, that can't be used; the message says what is wrong and where."""


class MeshWarning(UserWarning):
    """Something about a mesh file that its owner should know, though the work goes on."""
