#!/usr/bin/env bash
# Every check of the project, from a fresh clone: needs Rust and Python 3.11, makes the rest.
set -euo pipefail
cd "$(dirname "$0")/.."

# Nothing is built twice here.
export CARGO_INCREMENTAL=0
# Test failures name file and line without it.
export CARGO_PROFILE_DEV_DEBUG=0

step() { printf '\n== %s\n' "$*"; }

# Packages are fetched while Rust compiles.
environment() {
    source python-ref/environment.sh python-ref/peers/requirements.txt tests/python/requirements.txt
}
environment >/dev/null 2>&1 &
fetched=$!

if cargo fmt --version >/dev/null 2>&1; then
    step "format"
    cargo fmt --all --check
else
    step "format: skipped, rustfmt is not installed"
fi
# Lints are found while the workspace is compiled, by what `cargo clippy -- -D warnings` sets: a check
# of its own would read all dependencies once more.
if cargo clippy --version >/dev/null 2>&1; then
    export RUSTC_WORKSPACE_WRAPPER=clippy-driver
    export CLIPPY_ARGS="-D__CLIPPY_HACKERY__warnings__CLIPPY_HACKERY__"
else
    step "lints: skipped, clippy is not installed"
fi

step "build, with lints"
# As maturin builds the extension: then both share all that is compiled.
export PYO3_BUILD_EXTENSION_MODULE=1
cargo test --workspace --features cli --no-run

step "the library without its optional parts"
cargo check --package cfreg --lib

step "the reference's environment"
# A failure in the background is repeated, and told, here.
wait "$fetched" || true
environment

step "the reference: its own checks, and the golden cases"
(cd python-ref && "$python" -m unittest && "$python" -m reference.golden --check)

step "the Python package, and beside it 50 digits, the reference and Open3D"
MATURIN_PEP517_ARGS="--profile dev" "$python" -m pip install --quiet --disable-pip-version-check .
"$python" -m unittest discover tests/python
(cd python-ref && "$python" -m reference.comparisons)

step "manual"
"$python" -m pip install --quiet --disable-pip-version-check -r docs/requirements.txt
"$python" docs/cli_reference.py --check "${CARGO_TARGET_DIR:-target}/debug/cfreg"
NO_MKDOCS_2_WARNING=1 "$python" -m mkdocs build --quiet --strict

step "the methods beside their peers, in small"
(cd python-ref && "$python" -m peers.methods --smoke)

step "how fast beside the peers: that it runs"
(cd python-ref && "$python" -m peers.speed --points 1000 --only moments,features)
(cd python-ref && "$python" -m unittest peers.tests.test_throughput)

step "peers that the paper does not have, in small"
(cd python-ref && "$python" -m peers.paper_trials --smoke)

step "the data folder"
"$python" -m unittest discover data

step "the crates"
cargo test --workspace --features cli

step "its pages in a browser"
if [ ! -x /usr/bin/chromedriver ] && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    apt-get update -qq
    apt-get install -y -qq --no-install-recommends chromium chromium-driver >/dev/null
fi
if [ -x /usr/bin/chromedriver ]; then
    "$python" -m pip install --quiet --disable-pip-version-check -r tests/browser/requirements.txt
    "$python" -m unittest discover tests/browser
else
    echo "skipped: /usr/bin/chromedriver is not there (Debian's chromium and chromium-driver)"
fi

step "the paper's experiments, in small"
scans="${CFREG_DATA:-$PWD/../shared/data}"
if [ -d "$scans" ]; then
    rm -rf target/smoke
    "${CARGO_TARGET_DIR:-target}/debug/cfreg-paper" reproduce --smoke --data "$scans" --output target/smoke >/dev/null
else
    echo "skipped: neither \$CFREG_DATA nor ../shared/data is there"
fi

step "the report"
bash paper/report/build.sh target/report.pdf
