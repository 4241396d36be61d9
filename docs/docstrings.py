"""Turns the docstrings of the package into Markdown for the manual.

A part is `name : text`, its continuation indented; `Parameters` and its kin are underlined; examples
are doctests.
"""

import importlib
import inspect
import re

import griffe

HEADINGS = {"Parameters", "Returns", "Raises", "Examples", "Attributes", "Notes"}
PART = re.compile(r"^([A-Za-z_][\w, *]*?) : (.*)$")
INDENTED = re.compile(r"^ +\S")


def to_markdown(docstring: str) -> str:
    lines, made, within = docstring.splitlines(), [], None
    for i, line in enumerate(lines):
        following = lines[i + 1].strip() if i + 1 < len(lines) else ""
        is_rule = bool(line.strip()) and set(line.strip()) == {"-"}
        if line.strip() in HEADINGS and following and set(following) == {"-"}:
            made += ["", f"**{line.strip()}**", ""]
            within = None
        elif is_rule:
            continue
        elif line.startswith((">>>", "...")):
            if within != "example":
                made += ["", "```pycon"]
            made.append(line)
            within = "example"
        elif within == "example":
            if line.strip():
                made.append(line)
            else:
                made += ["```", ""]
                within = None
        elif match := PART.match(line):
            if within != "parts":
                made.append("")
            names = ", ".join(f"`{name.strip()}`" for name in match[1].split(","))
            made.append(f"- {names}: {match[2]}")
            within = "parts"
        elif within == "parts" and INDENTED.match(line):
            made.append(f"  {line.strip()}")
        else:
            if within == "parts" and line.strip():
                made.append("")
            within = None
            made.append(line)
    if within == "example":
        made.append("```")
    return "\n".join(made).strip()


class MarkdownDocstrings(griffe.Extension):
    def on_object(self, *, obj: griffe.Object, **kwargs: object) -> None:
        text = obj.docstring.value if obj.docstring else compiled_text(obj.path)
        if text:
            obj.docstring = griffe.Docstring(to_markdown(text), parent=obj)


def compiled_text(path: str) -> str | None:
    """The text of a compiled part, whose stub has none, where the package is installed."""
    if not path.startswith("cfreg._native."):
        return None
    try:
        thing = importlib.import_module("cfreg._native")
    except ImportError:
        return None
    for name in path.split(".")[2:]:
        thing = getattr(thing, name, None)
    return inspect.getdoc(thing) if callable(thing) or inspect.isdatadescriptor(thing) else None
