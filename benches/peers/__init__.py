"""The package beside its peers: how much faster, and whether the answer is the same."""
