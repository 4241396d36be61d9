"""The package beside its peers: how much faster, and whether the answer is the same."""

from peers.timing import in_words


def row(what, ours, theirs, peer, same):
    """Two times in seconds, and the ratio."""
    return f"{what:<46} {in_words(ours):>9} {in_words(theirs):>9} {theirs / ours:6.2f}x  {peer:<26} {same}"
