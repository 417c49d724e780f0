# SPDX-License-Identifier: Apache-2.0
"""Pictures and pages of logs and captures. The only room that imports matplotlib.

It may import can, drive and runs.
"""
