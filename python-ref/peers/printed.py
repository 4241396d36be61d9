"""Tables in Markdown, and lines that are printed as they come and kept for a file."""


def table_line(cells):
    return "|" + "".join(f" {cell} |" if cell != "" else " |" for cell in cells)


def rule_line(count):
    """The line between titles and rows."""
    return "|" + "---|" * count


def table(titles, rows):
    """The lines of a table in Markdown."""
    return [table_line(titles), rule_line(len(titles)), *map(table_line, rows)]


class Transcript:
    """Lines that were printed."""

    def __init__(self):
        self.lines = []

    def say(self, line=""):
        print(line, flush=True)
        self.lines.append(line)

    def write(self, path):
        """To a file, if one is named."""
        if path:
            path.write_text("\n".join(self.lines) + "\n")
