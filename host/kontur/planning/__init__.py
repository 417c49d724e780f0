# SPDX-License-Identifier: Apache-2.0
"""From a path to a trajectory: bounds of speed, the planner, knots of the spline that the drive follows, path time.

Pure computing, without a bus. It may import path, and from can the ranges of the wire.
"""
