"""Register the trials of the paper's Tables I and II by methods that it does not have.

    cfreg-paper reproduce --pairs PAIRS --output RESULTS && python -m peers.paper_trials PAIRS RESULTS
    python -m peers.paper_trials --smoke    two trials each, of a procedural relief, which all
                                           must find

Writes every trial to RESULTS/peers/ and RESULTS/peers.md, a table of them beside this
crate's methods, whose trials are in RESULTS/trials/ once `cfreg-paper reproduce` has run.
"""

from peers import processors

# Open3D's RANSAC gives random numbers to its threads in the order they come; it has as many
# threads as processors (OMP_NUM_THREADS is not heeded). Before it is loaded: one.
processors.limit(1)

import argparse
import sys
import tempfile
from pathlib import Path

from peers.paper_trials import pairs, paper_tables, trials
from peers.paper_trials.contenders import installed

OURS = {"CF": "cf", "CF, dual softmax": "cf-both", "CF multiscale": "cf-multiscale", "TEASER": "teaser"}
"""Rows of this crate and how its files call them."""


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("pairs", nargs="?", type=Path, help="folder that cfreg wrote")
    arguments.add_argument("results", nargs="?", type=Path, help="folder of the results")
    arguments.add_argument("--smoke", action="store_true", help="two trials a cell, in seconds")
    options = arguments.parse_args()
    if options.pairs is None and not options.smoke:
        arguments.error("without --smoke it needs a folder of pairs")
    if options.pairs is not None and options.results is None:
        arguments.error("it needs a folder for the results")
    cells = pairs.reliefs(2) if options.pairs is None else pairs.read(options.pairs)
    cells = [pairs.Cell(c.name, c.pairs[:2]) if options.smoke else c for c in cells]
    if not cells:
        arguments.error(f"no pairs in {options.pairs}")
    with tempfile.TemporaryDirectory() as scratch:
        results = run(cells, options.results or Path(scratch))
    if options.pairs is None:
        # The relief is easy: who loses it was called wrongly.
        rows = (row for rows in results.values() for row in rows.items())
        lost = [row for row, records in rows if any(record.lost() for record in records)]
        return f"lost on the relief: {', '.join(lost)}" if lost else 0
    return 0


def run(cells, folder):
    """Registers the cells by all that is installed, writes trials and table."""
    (folder / "peers").mkdir(parents=True, exist_ok=True)
    contenders, results = list(installed()), {}
    for cell in cells:
        results[cell.name] = {}
        for row, word in OURS.items():
            if (path := folder / "trials" / f"{cell.name}_{word}.csv").is_file():
                records = trials.read(path)
                if len(records) == len(cell.pairs):
                    results[cell.name][row] = records
                else:
                    print(f"left out: {path} has {len(records)} trials", file=sys.stderr)
        for contender in contenders:
            path = folder / "peers" / f"{cell.name}_{contender.file_name()}.csv"
            records = trials.register(contender, cell)
            title = contender.title()
            trials.write(records, path, cell=cell.name, method=title, settings=contender.settings)
            results[cell.name][title] = records
        print(f"{cell.name}: done", file=sys.stderr, flush=True)
    text = paper_tables.markdown(results, contenders)
    (folder / "peers.md").write_text(text)
    print(text, end="")
    return results


if __name__ == "__main__":
    sys.exit(main())
