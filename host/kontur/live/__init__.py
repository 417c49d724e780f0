# SPDX-License-Identifier: Apache-2.0
"""A page for the browser beside a command that moves axes: what goes on, and hold, resume, stop, feed override.

`view` keeps what the page shows, `server` serves it, and `follow` watches a drive that runs no path. The page needs
aiohttp, the extra `live`.
"""
