"""Fixtures of the tests of files."""

from pathlib import Path

import pytest


@pytest.fixture
def put(tmp_path):
    """Write a file and give back its path."""

    def write(name: str, content: str | bytes) -> Path:
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write
