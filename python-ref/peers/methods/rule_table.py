"""One line of the table of peers: what was compared, what was found, whether it holds."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    method: str
    """The crate's name of it."""
    peer: str
    clouds: str
    quantity: str
    """With its unit."""
    found: str
    rule: str = ""
    """The condition that must hold; empty where figures are only shown."""
    holds: bool = True

    def line(self):
        mark = "  " if not self.rule else ("ok" if self.holds else "NO")
        return (
            f"{self.method:10} {self.peer:24} {self.clouds:30} {self.quantity:32} "
            f"{self.found:>22}  {mark} {self.rule}"
        )


HEADER = Row("method", "peer", "clouds", "quantity", "found (ours | peer)", "rule").line()


def difference(method, peer, clouds, quantity, value, at_most=None):
    """A difference between the crate and a peer, and the most it may be."""
    rule = "" if at_most is None else f"at most {at_most:g}"
    holds = at_most is None or bool(value <= at_most)
    return Row(method, peer, clouds, quantity, f"{value:.2e}", rule, holds)


def successes(method, peer, clouds, ours, theirs, trials):
    """How often either finds the pose: ours at least as often."""
    found = f"{ours} | {theirs} of {trials}"
    return Row(method, peer, clouds, "found", found, "at least as many", ours >= theirs)


def errors(method, peer, clouds, quantity, ours, theirs, slack=1.1):
    """An error of either, ours at most `slack` times the peer's."""
    found = f"{ours:.4g} | {theirs:.4g}"
    return Row(method, peer, clouds, quantity, found, f"at most {slack:g} x", bool(ours <= slack * theirs))


def figures(method, peer, clouds, quantity, ours, theirs):
    """Two figures side by side that need not agree."""
    return Row(method, peer, clouds, quantity, f"{ours:.4g} | {theirs:.4g}")
