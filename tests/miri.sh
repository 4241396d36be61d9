#!/usr/bin/env bash
# The safe core under Miri, which finds undefined behaviour: math, closed forms, priors, weights,
# clouds, transforms, sums of moments.
#
#     bash tests/miri.sh [FILTER...]
#
# Needs `rustup component add miri rust-src --toolchain nightly`. It leaves out what Miri cannot do
# or only in days: SIMD (pulp), faer's decompositions, crews of threads, clouds of real size.
set -euo pipefail
cd "$(dirname "$0")/.."

filters=("$@")
if [ ${#filters[@]} = 0 ]; then
    filters=(math:: pose:: weight:: cloud:: moments::sums)
fi
# Property tests with few cases: Miri takes a thousand times longer. Their files of failures, and
# temporary folders, want the system; pools of threads are never taken down.
export PROPTEST_CASES=2 MIRIFLAGS="-Zmiri-disable-isolation -Zmiri-ignore-leaks"
exec cargo +nightly miri test --no-default-features --lib -- "${filters[@]}"
