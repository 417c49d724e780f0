# SPDX-License-Identifier: Apache-2.0
"""Kontur: host tools of a contouring drive. The command `kontur` is built from these modules; docs/architecture.md has the map."""

__version__ = "0.1.0"
