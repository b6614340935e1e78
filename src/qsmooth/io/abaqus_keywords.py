"""Lines of keywords in Abaqus's files; there may be hundreds of thousands."""

from __future__ import annotations

import re

HEAD = re.compile(rb"(?m)^[ \t]*\*[^\r\n]*")
Keyword = tuple[str, dict[str, str]]


def keyword_lines(clean: bytes) -> tuple[list[Keyword], list[int], list[int]]:
    """Each keyword with its options, its first byte, and the end of its line or lines."""
    known: dict[bytes, Keyword] = {}
    keywords, begins, ends = [], [], []
    for match in HEAD.finditer(clean):
        head, (begin, end) = match[0], match.span()
        if head.rstrip().endswith(b","):
            end = _end_of_head(clean, end)
            head = clean[begin:end]
        if head not in known:
            known[head] = _keyword(head)
        keywords.append(known[head])
        begins.append(begin)
        ends.append(end)
    return keywords, begins, ends


def _end_of_head(clean: bytes, end: int) -> int:
    """Where a keyword ends that goes on in the next line that is not empty."""
    goes_on = True
    while goes_on and end < len(clean):
        following = clean.find(b"\n", end + 2)
        following = len(clean) if following < 0 else following
        line = clean[end:following].strip()
        if line.startswith(b"*"):
            break
        goes_on, end = not line or line.endswith(b","), following
    return end


def _keyword(head: bytes) -> Keyword:
    """Keyword and options of its line, or lines."""
    first, *words = head.decode("latin-1").strip().lstrip("*").split(",")
    options = {}
    for word in words:
        option, _, value = word.partition("=")
        options[option.strip().upper()] = value.strip().strip('"')
    return " ".join(first.upper().split()), options
