# Sourced: makes the Python environment of the checks and sets `python` to it. Needs Python
# 3.11; arguments are more files of requirements.
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
venv="$here/../target/python"
python3 -m venv "$venv"
python="$(cd "$venv" && pwd)/bin/python"
for requirements in "$here/requirements.txt" "$@"; do
    "$python" -m pip install --quiet --disable-pip-version-check -r "$requirements"
done
# Open3D's wheel loads libraries of the system that a bare Debian does not have.
if ! "$python" -c "import open3d" 2>/dev/null && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    apt-get update -qq
    apt-get install -y -qq libusb-1.0-0 libgl1 libegl1 libgomp1 libx11-6 >/dev/null
fi
(cd "$here" && "$python" system_libraries.py)
