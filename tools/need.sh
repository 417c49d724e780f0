#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# need.sh STAMP TRIAL PACKAGE...: unless the shell command TRIAL succeeds, install these Debian packages; then it must.
# Packages are installed as root, or by sudo where that asks nothing; else a message names them. STAMP is touched.
stamp=$1 trial=$2
shift 2
mkdir -p "$(dirname "$stamp")"
exec 9>"$(dirname "$stamp")/lock"
flock 9
try() { sh -c "$trial" >"$stamp.log" 2>&1 && touch "$stamp"; }
try && exit
if [ "$(id -u)" = 0 ]; then root=; elif sudo -n true 2>/dev/null; then root="sudo -n"; else root=no; fi
if [ "$root" = no ] || ! command -v apt-get >/dev/null; then
    echo "make: Debian packages are missing; install them, e.g. with: sudo apt-get install $*"
    exit 1
fi
echo "Installing Debian packages: $*"
$root apt-get update -qq && $root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" || exit 1
try && exit
cat "$stamp.log"
echo "make: fails with these Debian packages installed: $*"
exit 1
