#!/usr/bin/env bash
# How fast is it beside its peers? Installs those that have packages, builds the package,
# measures both in turn and prints one table. Arguments as of `python -m peers`:
# --threads 1 --points 30000 --only moments,features --output results/NAME.txt
set -euo pipefail
cd "$(dirname "$0")"
source ../python-ref/environment.sh ../python-ref/requirements-peers.txt peers/requirements.txt
source ../python-ref/pcl/install.sh
"$python" -m pip install --quiet --disable-pip-version-check ..
"$python" -m peers "$@"
