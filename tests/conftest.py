# SPDX-License-Identifier: Apache-2.0
"""The control core as a shared library, for the tests that compare it with the oracle."""

import pytest
from core.binding import Core


@pytest.fixture(scope="session", params=["f32", "fix"])
def core(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Core:
    """The core, compiled from the checkout, in each numeric back end."""
    return Core(request.param, tmp_path_factory.mktemp("core"))
