# SPDX-License-Identifier: Apache-2.0
"""Paths as geometry: lines, arcs and ideal shapes, and what reads them from G-code and CSV files.

It imports nothing but the ground floor (kontur.errors).
"""
