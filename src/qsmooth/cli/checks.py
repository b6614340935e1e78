"""Checks as pipelines read them: annotations of GitHub's workflows, and JUnit's ElementTree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

if TYPE_CHECKING:
    from qsmooth.metrics import Check

# https://docs.github.com/actions/reference/workflow-commands-for-github-actions: what would end a
# message, or a property of it, is written by its code.
IN_MESSAGES = {"%": "%25", "\r": "%0D", "\n": "%0A"}
IN_PROPERTIES = {**IN_MESSAGES, ":": "%3A", ",": "%2C"}


def workflow_commands(path: Path, checks: Iterable[Check]) -> list[str]:
    """Workflow commands, one for each check that failed."""
    where = _escaped(str(path), IN_PROPERTIES)
    return [
        f"::error file={where},title={_escaped(f'qsmooth: {title(check)}', IN_PROPERTIES)}"
        f"::{_escaped(check.text, IN_MESSAGES)}"
        for check in checks
        if not check.passed
    ]


def junit(path: Path, checks: Sequence[Check], seconds: float) -> bytes:
    """JUnit's XML of a suite with a test case for each check."""
    n_failed = sum(not check.passed for check in checks)
    counts = {"tests": str(len(checks)), "failures": str(n_failed), "errors": "0"}
    suites = ElementTree.Element("testsuites", counts)
    suite = ElementTree.SubElement(
        suites, "testsuite", {"name": "qsmooth quality", "time": f"{seconds:.3f}", **counts}
    )
    for check in checks:
        case = ElementTree.SubElement(
            suite, "testcase", classname=_plain(str(path)), name=title(check)
        )
        if not check.passed:
            failure = {"type": check.rule, "message": check.text}
            ElementTree.SubElement(case, "failure", failure).text = check.text
    ElementTree.indent(suites)
    text: bytes = ElementTree.tostring(suites, encoding="utf-8", xml_declaration=True)
    return text + b"\n"


def title(check: Check) -> str:
    """What a check asks, in a few words: "min_angle not below 20"."""
    if check.threshold is None:
        return f"no cell {check.rule}"
    return f"{check.metric} not {check.rule} {check.threshold:g}"


def _escaped(text: str, codes: Mapping[str, str]) -> str:
    return "".join(codes.get(letter, letter) for letter in text)


def _plain(text: str) -> str:
    """A name without what XML has no way to write."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
