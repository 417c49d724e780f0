# SPDX-License-Identifier: Apache-2.0
"""Hypothesis draws the same examples in every run: a failure in CI is a failure here."""

from hypothesis import settings

settings.register_profile("kontur", derandomize=True, database=None, deadline=None)
settings.load_profile("kontur")
