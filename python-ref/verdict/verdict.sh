#!/usr/bin/env bash
# Fits the verdict of `consensus`, and prints the value of the fit on sources that were left out:
# every pose that is refined for the real pairs and for unrelated ones, with the sensors' places at
# the zero of the files and without. The argument is the folder of the scans (with pairs.csv and
# pairs_more.csv). VERDICT_EVERY=10 takes every tenth pair, of unrelated pairs every twentieth.
set -euo pipefail
folder="$(cd "${1:-${CFREG_DATA:?names the folder of the scans}}" && pwd)"
shift "$#" # a sourced file takes arguments for its own
cd "$(dirname "$0")/.."
source environment.sh
every="${VERDICT_EVERY:-1}"
tables=()
candidates() {
    tables+=("../target/verdict-$1-$2.csv")
    run_cfreg benchmark "${@:4}" --folder "$folder" --viewpoints "$2" --every "$3" \
        --candidates "${tables[-1]}" >&2
}
for viewpoints in origin none; do
    candidates pairs "$viewpoints" "$every" "$folder/pairs.csv" "$folder/pairs_more.csv"
    candidates unrelated "$viewpoints" "$((2 * every))" ../data/unrelated.csv
done
"$python" -m verdict.fit_verdict "${tables[@]}"
