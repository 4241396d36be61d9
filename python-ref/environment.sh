# Sourced: makes the Python environment of the checks and sets `python` to it. Needs Python
# 3.11; arguments are more files of requirements. Also defines how the crate is run.
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
repository="$(dirname "$here")"
python3 -m venv "$repository/target/python"
python="$(cd "$repository/target/python" && pwd)/bin/python"
for requirements in "$here/requirements.txt" "$@"; do
    "$python" -m pip install --quiet --disable-pip-version-check -r "$requirements"
done
# Open3D's wheel loads libraries of the system that a bare Debian does not have.
if ! "$python" -c "import open3d" 2>/dev/null && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    apt-get update -qq
    apt-get install -y -qq libusb-1.0-0 libgl1 libegl1 libgomp1 libx11-6 >/dev/null
fi
(cd "$here" && "$python" -m peers.programs.open3d)

# Builds and installs the crate's package.
install_package() {
    "$python" -m pip install --quiet --disable-pip-version-check "$repository"
}

# Builds the crate's program and runs it.
run_cfreg() {
    cargo run --quiet --release --manifest-path "$repository/Cargo.toml" --features cli -- "$@"
}
