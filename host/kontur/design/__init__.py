# SPDX-License-Identifier: Apache-2.0
"""Parameters of a drive from the file of its machine, under margins.

`loop` has the loop in the frequency domain: the law, whose response the firmware itself gives, and the machine.
`search` finds the gains, `trial` lets them drive the simulated machine, `figure` draws margins. `kontur design` is the
command.
"""
