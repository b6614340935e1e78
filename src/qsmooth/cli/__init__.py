"""The command line: a module a command; options are made from those of the methods."""

from qsmooth.cli.app import main, run

__all__ = ["main", "run"]
