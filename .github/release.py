"""Releases: that all places name one version, and what the changelog says of it.

    python .github/release.py check v0.1.0     fails where a place does not name the version of the tag
    python .github/release.py notes v0.1.0     prints the changelog's section of the tag
"""

import re
import sys
import tomllib
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
UNRELEASED = "Unreleased"


def versions(root=REPOSITORY):
    """The version that each file names."""

    def toml(path):
        return tomllib.loads((root / path).read_text(encoding="utf-8"))

    found = {path: toml(path)["package"]["version"] for path in ("Cargo.toml", "python/Cargo.toml")}
    locked = {package["name"]: package["version"] for package in toml("Cargo.lock")["package"]}
    found |= {f"Cargo.lock: {name}": locked[name] for name in ("cfreg", "cfreg-python")}
    project = toml("pyproject.toml")["project"]
    # A dynamic version is that of python/Cargo.toml.
    if "version" not in project.get("dynamic", []):
        found["pyproject.toml"] = project["version"]
    citation = (root / "CITATION.cff").read_text(encoding="utf-8")
    found["CITATION.cff"] = re.search(r'^version: "?([^"\s]+)', citation, re.MULTILINE)[1]
    return found


def sections(root=REPOSITORY):
    """Version and text of each section of the changelog, the newest first: `## 0.1.0 (2026-12-01)`."""
    text = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    parts = re.split(r"^## (\S+).*\n", text, flags=re.MULTILINE)[1:]
    return [(version, body.strip()) for version, body in zip(parts[::2], parts[1::2])]


def faults(tag, root=REPOSITORY):
    """Sentences about all that forbids a release under this tag."""
    version = tag.removeprefix("v")
    if not tag.startswith("v"):
        yield f"{tag} is no tag of a release: v0.1.0"
    for place, named in versions(root).items():
        if named != version:
            yield f"{place} names {named}, the tag {tag}"
    newest, text = sections(root)[0]
    if newest != version:
        yield f"the first section of CHANGELOG.md is {newest}, the tag {tag}"
    elif not text:
        yield f"the section {newest} of CHANGELOG.md is empty"


def notes(tag, root=REPOSITORY):
    """The changelog's section of a tag."""
    return dict(sections(root))[tag.removeprefix("v")]


def main():
    if len(sys.argv) != 3 or sys.argv[1] not in ("check", "notes"):
        sys.exit(__doc__)
    _, command, tag = sys.argv
    if command == "notes":
        print(notes(tag))
    elif found := list(faults(tag)):
        sys.exit("\n".join(found))


if __name__ == "__main__":
    main()
