"""Methods that the paper does not have, on the very trials of its Tables I and II."""
