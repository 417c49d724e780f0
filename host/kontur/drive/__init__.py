# SPDX-License-Identifier: Apache-2.0
"""A drive at the other end of the bus: its objects, its state machine, streaming, single axes, its scope.

It may import can, and from planning the model of path time. It imports no simulator.
"""
