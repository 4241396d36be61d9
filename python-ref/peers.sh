#!/usr/bin/env bash
# The crate's methods beside their best-known implementations, as one table: installs the
# peers that have packages, builds the crate's module, compares. Arguments as of
# `python -m peers`: --only icp,cpd --smoke --output table.txt
set -euo pipefail
cd "$(dirname "$0")"
source environment.sh requirements-peers.txt
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null && ! dpkg -s libpcl-dev cmake >/dev/null 2>&1; then
    apt-get update -qq
    apt-get install -y -qq libpcl-dev cmake >/dev/null || echo "PCL could not be installed: left out"
fi
"$python" -m pip install --quiet --disable-pip-version-check ..
"$python" -m peers "$@"
