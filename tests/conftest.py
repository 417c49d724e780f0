# SPDX-License-Identifier: Apache-2.0
"""What all tests share: the control core as a shared library, Ctrl-C that the programs under test hear, no tool that
may be missing in CI."""

import os
import re
import signal
from collections.abc import Generator

import pytest
from core.binding import Core


def pytest_configure() -> None:
    """A shell that starts the tests in the background has them ignore SIGINT, and every program they start."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """In CI a tool that is missing or not built is a failure, never a skip."""
    report = yield
    if report.skipped and "CI" in os.environ and isinstance(report.longrepr, tuple):
        reason = report.longrepr[2]
        if re.search("apt-get install|is not built|is not there", reason):
            report.outcome = "failed"
            report.longrepr = reason
    return report


@pytest.fixture(scope="session", params=["f32", "fix"])
def core(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Core:
    """The core, compiled from the checkout, in each numeric back end."""
    return Core(request.param, tmp_path_factory.mktemp("core"))
