# SPDX-License-Identifier: Apache-2.0
"""The names of the axes, and of the ways to home one."""

from __future__ import annotations

AXES = ("x", "y")
METHODS = {
    "here": 37,
    "switch-": 17,
    "switch+": 18,
    "switch-index-": 1,
    "switch-index+": 2,
    "index-": 33,
    "index+": 34,
}
"""Homing methods (6098h): the axis' position; the limit switch at the negative or positive end, alone or with the first
index pulse off it; the next index pulse in negative or positive direction."""
