# SPDX-License-Identifier: Apache-2.0
"""`python -m kontur.cli`."""

from kontur.cli import main

main()
