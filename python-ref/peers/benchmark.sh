#!/usr/bin/env bash
# Global registration of real pairs, the crate's and its peers', as one table: installs the peers
# that have packages, builds the crate, runs both. The first argument is the folder of the scans
# (with pairs.csv), the others go to `cfreg benchmark`. BENCHMARK_EVERY=10 takes every tenth pair.
set -euo pipefail
folder="$(cd "${1:-${CFREG_DATA:?names the folder of the scans}}" && pwd)"
shift || true
cd "$(dirname "$0")/.."
source environment.sh peers/requirements.txt
source pcl/install.sh
install_package
every="${BENCHMARK_EVERY:-1}"
poses="../target/benchmark-poses-$every.csv"
"$python" -m peers.benchmark "$folder/pairs.csv" --origin --every "$every" --output "$poses"
run_cfreg benchmark "$folder/pairs.csv" --viewpoints origin --every "$every" --poses "$poses" "$@"
