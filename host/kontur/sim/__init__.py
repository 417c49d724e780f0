# SPDX-License-Identifier: Apache-2.0
"""The simulated drive: the firmware as a library, as a python-can bus, as a process, and the image in QEMU.

It may import can. Nobody below experiments and cli imports it: python-can loads it by the interface "kontur".
"""

NUMS = ("f32", "fix", "chk")
"""Numeric back ends of the simulated firmware."""
