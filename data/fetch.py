#!/usr/bin/env python3
"""Fetches the scans of manifest.json into data/scans, from a mirror or from their public home.

    python3 data/fetch.py            # all of them
    python3 data/fetch.py bun000     # one

A mirror is the folder $CFREG_DATA, else ../shared/data beside the repository. Without one the
archives are downloaded. Every file is checked against its sha256 before it is put in place.
Only Python's standard library is needed.
"""

import argparse
import hashlib
import io
import json
import os
import sys
import tarfile
import urllib.error
import urllib.request
from pathlib import Path

HERE = Path(__file__).resolve().parent
MOST_BYTES = 200 * 2**20  # no archive of the manifest is larger


class Failed(Exception):
    """A scan could not be had; the message says why."""


def mirror():
    """The folder of the local mirror, or None."""
    named = os.environ.get("CFREG_DATA")
    if named:
        return Path(named)
    beside = HERE.parent.parent / "shared" / "data"
    return beside if beside.is_dir() else None


def download(url, cache):
    """The bytes of an archive; each is downloaded once a run."""
    if url not in cache:
        try:
            with urllib.request.urlopen(url, timeout=60) as answer:
                content = answer.read(MOST_BYTES + 1)
        except (urllib.error.URLError, OSError) as error:
            raise Failed(f"{url}: {error}; set CFREG_DATA to a folder that has the scans") from error
        if len(content) > MOST_BYTES:
            raise Failed(f"{url}: larger than {MOST_BYTES} bytes")
        cache[url] = content
    return cache[url]


def member(content, name, url):
    """One regular file out of a .tar.gz, read in memory: nothing else is unpacked."""
    try:
        with tarfile.open(fileobj=io.BytesIO(content), mode="r:gz") as archive:
            file = archive.extractfile(name)
            if file is None:
                raise Failed(f"{url}: {name} is not a file")
            return file.read()
    except (tarfile.TarError, KeyError, OSError) as error:
        raise Failed(f"{url}: cannot take {name} from it: {error}") from error


def fetch(scan, folder, cache):
    """Puts one scan into `folder`; returns where it came from."""
    root = mirror()
    if root is not None:
        origin = root / scan["mirror"]
        try:
            content = origin.read_bytes()
        except OSError as error:
            raise Failed(f"{origin}: {error.strerror}") from error
    else:
        origin = scan["archive"]
        content = member(download(origin, cache), scan["member"], origin)
    found = hashlib.sha256(content).hexdigest()
    if found != scan["sha256"]:
        raise Failed(f"{origin}: sha256 of {scan['name']} is {found}, not {scan['sha256']}")
    folder.mkdir(parents=True, exist_ok=True)
    partial = folder / (scan["name"] + ".part")
    partial.write_bytes(content)
    partial.replace(folder / (scan["name"] + ".ply"))
    return origin


def main(names):
    manifest = json.loads((HERE / "manifest.json").read_text())
    scans = {scan["name"]: scan for scan in manifest["scans"]}
    unknown = [name for name in names if name not in scans]
    if unknown:
        print(f"fetch: no scan {', '.join(unknown)}; there are {', '.join(scans)}", file=sys.stderr)
        return 1
    folder = Path(os.environ.get("CFREG_SCANS", HERE / "scans"))
    cache = {}
    for name in names or scans:
        try:
            origin = fetch(scans[name], folder, cache)
        except Failed as failed:
            print(f"fetch: {failed}", file=sys.stderr)
            return 1
        print(f"{folder / name}.ply  from {origin}")
    return 0


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("names", nargs="*", metavar="NAME", help="a scan; all of them by default")
    sys.exit(main(arguments.parse_args().names))
