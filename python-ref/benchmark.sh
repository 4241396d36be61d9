#!/usr/bin/env bash
# Global registration of real pairs, the crate's and its peers', as one table: installs the peers
# that have packages, builds the crate, runs both. The first argument is the folder of the scans
# (with pairs.csv), the others go to `cfreg benchmark`. BENCHMARK_EVERY=10 takes every tenth pair.
set -euo pipefail
folder="$(cd "${1:-${CFREG_DATA:?names the folder of the scans}}" && pwd)"
shift || true
cd "$(dirname "$0")"
source environment.sh requirements-peers.txt
source pcl/install.sh
"$python" -m pip install --quiet --disable-pip-version-check ..
every="${BENCHMARK_EVERY:-1}"
poses="../target/benchmark-poses-$every.csv"
"$python" benchmark_peers.py "$folder/pairs.csv" --origin --every "$every" --output "$poses"
cargo run --quiet --release --manifest-path ../Cargo.toml --features cli --features cli -- benchmark "$folder/pairs.csv" \
    --viewpoints origin --every "$every" --poses "$poses" "$@"
