# SPDX-License-Identifier: Apache-2.0
"""What all tests share: the control core as a shared library, and Ctrl-C that the programs under test hear."""

import signal

import pytest
from core.binding import Core


def pytest_configure() -> None:
    """A shell that starts the tests in the background has them ignore SIGINT, and every program they start."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", params=["f32", "fix"])
def core(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Core:
    """The core, compiled from the checkout, in each numeric back end."""
    return Core(request.param, tmp_path_factory.mktemp("core"))
