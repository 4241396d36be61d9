#!/usr/bin/env bash
# The crate's methods beside their best-known implementations, as one table: installs the
# peers that have packages, builds the crate's module, compares. Arguments as of
# `python -m peers`: --only icp,cpd --smoke --output table.txt
set -euo pipefail
cd "$(dirname "$0")"
source environment.sh requirements-peers.txt
source pcl/install.sh
"$python" -m pip install --quiet --disable-pip-version-check ..
"$python" -m peers "$@"
