#!/usr/bin/env bash
# Makes the report from the results of `cfreg-paper reproduce`: build.sh [OUTPUT.pdf]. Needs Python
# 3.11; installs the typesetter into target/report.
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
output="$(realpath -m "${1:-$here/report.pdf}")"
root="$(cd "$here/.." && pwd)"
venv="$here/../../target/report"
[ -x "$venv/bin/python" ] || python3 -m venv "$venv"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check typst==0.15.2
"$venv/bin/python" - "$here/report.typ" "$output" "$root" <<'PYTHON'
import sys
from datetime import datetime, timezone

import typst

source, output, root = sys.argv[1:]
# A fixed time and no system fonts: the same results give the same bytes everywhere.
epoch = datetime(2020, 1, 1, tzinfo=timezone.utc)
typst.compile(source, output=output, root=root, ignore_system_fonts=True, timestamp=int(epoch.timestamp()))
PYTHON
echo "$output"
