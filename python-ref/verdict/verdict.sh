#!/usr/bin/env bash
# Fits the verdict of `consensus`, and says what the fit is worth: every pose that is settled
# for the real pairs and for the unrelated ones, with the sensors' places and without, then the
# constants beside those of the source and place by place left out, as tables. The argument is the
# folder of the scans (with pairs.csv). VERDICT_EVERY=10 takes every tenth pair.
set -euo pipefail
folder="$(cd "${1:-${CFREG_DATA:?names the folder of the scans}}" && pwd)"
shift "$#" # a sourced file takes arguments for its own
cd "$(dirname "$0")/.."
source environment.sh
candidates=()
for viewpoints in origin none; do
    candidates+=("../target/verdict-$viewpoints.csv")
    run_cfreg benchmark "$folder/pairs.csv" ../data/unrelated.csv --folder "$folder" \
        --viewpoints "$viewpoints" --every "${VERDICT_EVERY:-1}" --candidates "${candidates[-1]}" >&2
done
"$python" -m verdict.fit_verdict --held-out "${candidates[@]}"
