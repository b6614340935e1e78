"""Wording that messages and reports share."""


def plural(n: int, one: str, many: str = "") -> str:
    """Count things: "1 cell", "3 cells"."""
    return f"{n} {one if n == 1 else many or one + 's'}"
