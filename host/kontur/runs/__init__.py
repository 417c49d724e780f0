# SPDX-License-Identifier: Apache-2.0
"""One run: a trajectory on a drive under one controller, its log, and the score where the true position is known.

It may import path, planning, can and drive.
"""
