# SPDX-License-Identifier: Apache-2.0
"""Measuring an axis with its own drive: frequency response, mass, friction, first mode."""
