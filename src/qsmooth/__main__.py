"""``python -m qsmooth``: the command line."""

from qsmooth.cli import main

if __name__ == "__main__":
    main()
