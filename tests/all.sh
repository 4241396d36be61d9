#!/usr/bin/env bash
# Every check of the project, from a fresh clone: needs Rust and Python 3.11, makes the rest.
set -euo pipefail
cd "$(dirname "$0")/.."

step() { printf '\n== %s\n' "$*"; }

if cargo fmt --version >/dev/null 2>&1; then
    step "format"
    cargo fmt --check
else
    step "format: skipped, rustfmt is not installed"
fi
if cargo clippy --version >/dev/null 2>&1; then
    step "lints"
    cargo clippy --all-targets --quiet -- -D warnings
else
    step "lints: skipped, clippy is not installed"
fi

step "the reference's environment"
venv=target/python
python3 -m venv "$venv"
python="$PWD/$venv/bin/python"
"$python" -m pip install --quiet --disable-pip-version-check -r python-ref/requirements.txt
# Open3D's wheel loads libraries of the system that a bare Debian does not have.
if ! "$python" -c "import open3d" 2>/dev/null && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    apt-get update -qq
    apt-get install -y -qq libusb-1.0-0 libgl1 libegl1 libgomp1 libx11-6 >/dev/null
fi
(cd python-ref && "$python" system_libraries.py)

step "the reference: its own checks, and the golden cases"
(cd python-ref && "$python" -m unittest && "$python" golden.py --check)

step "the Python module, and the three side by side: module, reference, Open3D"
# The profile of the tests: their dependencies are compiled once for both.
MATURIN_PEP517_ARGS="--profile dev" "$python" -m pip install --quiet --disable-pip-version-check .
"$python" -m unittest discover tests/python
(cd python-ref && "$python" compare.py)

step "the data folder"
"$python" -m unittest discover data

step "the crate"
cargo test
