#!/usr/bin/env bash
# Speed beside the peers: installs those that have packages, builds the package, measures both in
# turn and prints one table. Arguments as for `python -m peers.speed` in `python-ref`:
# --threads 1 --points 30000 --only moments,features --output results/NAME.txt
set -euo pipefail
cd "$(dirname "$0")"
source ../python-ref/environment.sh ../python-ref/peers/requirements.txt ../python-ref/peers/speed/requirements.txt
source ../python-ref/pcl/install.sh
install_package
PYTHONPATH=../python-ref "$python" -m peers.speed "$@"
