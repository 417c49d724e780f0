#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# same_hash.sh HOST_PROGRAM TARGET_COMMAND...: whether both print the same hash of the closed loop.
host=$("$1") || { echo "$1: build it: cmake --build build/host-f32 --target hash (and host-fix)"; exit 1; }
shift
target=$("$@" 2>&1)
echo "closed loop on the target: $target, on the host: $host"
[ -n "$host" ] && [ "$target" = "$host" ]
