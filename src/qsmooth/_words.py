"""Wording that messages and reports share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence


def plural(n: int, one: str, many: str = "") -> str:
    """Count things: "1 cell", "3 cells"."""
    return f"{n} {one if n == 1 else many or one + 's'}"


def in_a_row(names: Sequence[str]) -> str:
    """List names in a sentence: "angle, quad and star"."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def capitalised(text: str) -> str:
    """Make the first letter large and leave the others, as of names, alone."""
    return text[:1].upper() + text[1:]


def did_you_mean(name: str, known: Iterable[str], spell: Callable[[str], str] = repr) -> str:
    """End a message about a name that is none: "; did you mean 'taper'?", or nothing."""
    from difflib import get_close_matches

    plain = {each.replace("_", "-").lower(): each for each in known}
    near = get_close_matches(str(name).replace("_", "-").lower(), plain, n=1)
    return f"; did you mean {spell(plain[near[0]])}?" if near else ""
