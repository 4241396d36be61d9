#!/usr/bin/env bash
# The safe core under Miri, which finds undefined behaviour: math, closed forms, moments without
# SIMD, weights, clouds, transforms, readers of files in memory.
#
# Needs `rustup component add miri rust-src --toolchain nightly`. About MINUTES minutes.
set -euo pipefail
cd "$(dirname "$0")/.."

# Property tests with few cases: Miri takes a thousand times longer.
export PROPTEST_CASES=2 MIRIFLAGS="-Zmiri-disable-isolation -Zmiri-ignore-leaks"
exec cargo +nightly miri test --no-default-features --lib -- "${@:-}" \
    math:: pose:: weight:: cloud:: moments::naive moments::sums
