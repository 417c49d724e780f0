# SPDX-License-Identifier: Apache-2.0
"""One run: a trajectory on a drive under one controller, its log, and the score where the true position is known.

It may import path, planning, can and drive.
"""

RETURN_MAX_M = 0.001
"""The longest way back to a path without being asked to approach: what axes creep, and no more."""
