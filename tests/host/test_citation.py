# SPDX-License-Identifier: Apache-2.0
"""CITATION.cff cites the version that pyproject.toml has."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def version(file: str, pattern: str) -> str:
    found = re.search(pattern, (ROOT / file).read_text(), re.MULTILINE)
    assert found, file
    return found[1]


def test_citation_has_the_version_of_the_package():
    assert version("CITATION.cff", "^version: (.+)$") == version("pyproject.toml", '^version = "(.+)"$')
