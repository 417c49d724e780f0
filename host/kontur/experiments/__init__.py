# SPDX-License-Identifier: Apache-2.0
"""Experiments that are defined here, so that everyone runs the same: the demonstration, the paper's, robustness, speed.

It may import every room but cli.
"""

REFERENCE = "ccu"
"""The law that the others are compared with (kontur.experiments.robust)."""
COMPARED = (REFERENCE, "cascade", "ccc")
