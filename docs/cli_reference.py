"""Write docs/reference/command_line.md from the help of the program itself.

    python docs/cli_reference.py [PROGRAM]

PROGRAM is the built program, `target/debug/cfreg` by default; `cargo build --features cli` makes it.
`--check` writes nothing and fails where the page is not what the program says.
"""

import argparse
import os
import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).parent / "reference" / "command_line.md"
HEAD = """\
# Command line

This page is made from the program itself: `python docs/cli_reference.py` runs `cfreg help` for every command.
`cargo install --path . --features cli` puts `cfreg` on the path.

The exit status is **0** for a result that may be used, **1** for a result with warnings, and **2** for no result, or for
one that could not be written.
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program", nargs="?", default="target/debug/cfreg")
    parser.add_argument("--check", action="store_true", help="only compare")
    options = parser.parse_args()
    page = "\n".join([HEAD, *sections(options.program, [])])
    if not options.check:
        PAGE.write_text(page, encoding="utf-8")
    elif PAGE.read_text(encoding="utf-8") != page:
        sys.exit(f"{PAGE} is not what {options.program} says: run docs/cli_reference.py")


def sections(program, command):
    """The help of a command and of those below it, one section each."""
    # Without a terminal the width of help is 100 columns.
    environment = {**os.environ, "NO_COLOR": "1"}
    asked = [program, "help", *command] if command else [program, "--help"]
    done = subprocess.run(asked, capture_output=True, text=True, check=True, env=environment)
    text = "\n".join(line.rstrip() for line in done.stdout.strip().splitlines())
    yield f"## {' '.join(['cfreg', *command])}\n\n```text\n{text}\n```\n"
    listed = re.search(r"^Commands:\n((?:  .*\n)+)", text + "\n", re.MULTILINE)
    for name in re.findall(r"^  (\w\S*) ", listed[1], re.MULTILINE) if listed else []:
        if name != "help":
            yield from sections(program, [*command, name])


if __name__ == "__main__":
    main()
