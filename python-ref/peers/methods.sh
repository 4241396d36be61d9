#!/usr/bin/env bash
# The crate's methods beside their best-known implementations, as one table: installs the
# peers that have packages, builds the crate's package, compares. Arguments as for
# `python -m peers.methods`: --only icp,cpd --smoke --output table.txt
set -euo pipefail
cd "$(dirname "$0")/.."
source environment.sh peers/requirements.txt
source pcl/install.sh
install_package
"$python" -m peers.methods "$@"
