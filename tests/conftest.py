# SPDX-License-Identifier: Apache-2.0
"""The control core as a shared library, for the tests that compare it with the oracle."""

import pytest
from core.binding import Core, build


@pytest.fixture(scope="session")
def core(tmp_path_factory: pytest.TempPathFactory) -> Core:
    """The core, compiled from the checkout."""
    return Core(build(tmp_path_factory.mktemp("core")))
