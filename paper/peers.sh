#!/usr/bin/env bash
# Methods that the paper does not have, on the very trials of its Tables I and II: builds
# cfreg, writes the trials' pairs, installs the peers, registers. The table comes to
# paper/results/peers.md, trials to paper/results/peers/; rows of this crate's methods are
# in it when `cfreg-paper reproduce` has run before. With --smoke two trials a cell, to paper/smoke.
set -euo pipefail
cd "$(dirname "$0")/.."
case "$*" in
    "") results="$PWD/paper/results" ;;
    --smoke) results="$PWD/paper/smoke" ;;
    *) echo "usage: paper/peers.sh [--smoke]" >&2 && exit 2 ;;
esac
pairs="$(mktemp -d)"
trap 'rm -rf "$pairs"' EXIT
source python-ref/environment.sh python-ref/peers/requirements.txt
cargo run --quiet --release --package cfreg-paper -- reproduce --pairs "$pairs" "$@"
cd python-ref
"$python" -m peers.paper_trials "$pairs" "$results" "$@"
