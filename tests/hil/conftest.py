# SPDX-License-Identifier: Apache-2.0
"""One suite for every drive: `pytest tests/hil --target inproc|slcan|vcan|qemu|can0` (docs/testing.md)."""

from collections.abc import Iterator

import pytest
from rig import Rig
from targets import Target, named


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("kontur", "the drive under test")
    group.addoption(
        "--target",
        help="inproc, slcan, vcan, qemu: simulated drives. A real one: the name of its SocketCAN interface (can0), or "
        "python-can's INTERFACE:CHANNEL[@BITRATE]; it moves within 2 mm of where it stands",
    )
    group.addoption("--no-motion", action="store_true", help="leave the axes without power")
    group.addoption("--node", type=int, default=1, help="node id of a real drive (default: 1)")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "motion: gives the axes power")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--target", default=None) is None:
        raise pytest.UsageError("tests/hil: which drive? --target inproc, slcan, vcan, qemu, or an interface: can0")
    if config.getoption("--no-motion"):
        for item in items:
            if item.get_closest_marker("motion"):
                item.add_marker(pytest.mark.skip(reason="--no-motion"))


@pytest.fixture(scope="session")
def target(pytestconfig: pytest.Config) -> Target:
    return named(pytestconfig.getoption("--target"), pytestconfig.getoption("--node"))


@pytest.fixture
def rig(target: Target) -> Iterator[Rig]:
    """The drive after reset node; its time passes with the host's frames where the target can do that."""
    with target.power_on() as drive, Rig(drive) as rig:
        yield rig


@pytest.fixture
def clock_rig(target: Target) -> Iterator[Rig]:
    """The same, but its time is the wall clock's."""
    with target.power_on(pace="clock") as drive, Rig(drive) as rig:
        yield rig
