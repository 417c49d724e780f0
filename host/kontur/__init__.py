# SPDX-License-Identifier: Apache-2.0
"""Kontur: host tools of a contouring drive. The map of these modules is in docs/architecture.md."""

__version__ = "0.1.0"
