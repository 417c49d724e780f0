# SPDX-License-Identifier: Apache-2.0
"""Kontur: host tools of a contouring drive. The map of these modules is in docs/architecture.md."""

from importlib.metadata import version

__version__ = version("kontur")
