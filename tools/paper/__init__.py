# SPDX-License-Identifier: Apache-2.0
"""What makes docs/paper.md: the page, its words and its pictures (tools/paper_page.py is the command)."""
