"""No module imports itself by way of others, wherever in a file the imports stand.

The contracts in `pyproject.toml` order the rooms; this is about single modules, and counts a
package's own `__init__` as one, which the contracts do not.
"""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import qsmooth

SOURCE = Path(qsmooth.__file__).parent


def modules():
    """Files by the names of their modules, without the package's own: it loads names lazily."""
    files = {}
    for file in SOURCE.rglob("*.py"):
        parts = file.relative_to(SOURCE.parent).with_suffix("").parts
        files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    del files["qsmooth"]
    return files


def imports(file, known):
    """Names of the modules that a file imports, in functions and for type checkers too."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: a relative import"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                if inner in known or node.module in known:
                    yield inner if inner in known else node.module


def test_there_is_no_circle_of_imports():
    known = modules()
    graph = {name: set(imports(file, known)) - {name} for name, file in known.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))
