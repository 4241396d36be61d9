"""The one table: every quantity with the worst value seen, its bound and the reason."""

LINE = "{:58} {:>9} {:>8}  {:50} {}"
HEADER = LINE.format("quantity", "value", "at most", "who", "because")


def print_section(title, rows, bounds):
    """Print the worst of each quantity and return what exceeds its bound, in words."""
    print(f"\n{title}")
    exceeded = []
    for quantity, value, who in worst_first_seen(rows):
        bound, reason = bounds.get(quantity, (None, ""))
        limit = "" if bound is None else f"{bound:.0e}"
        print(LINE.format(quantity, f"{value:.2e}", limit, who, reason).rstrip(), flush=True)
        if bound is not None and not value <= bound:
            exceeded.append(f"{title}: {quantity} is {value:.3g}, at most {bound:g} ({reason}): {who}")
    return exceeded


def worst_first_seen(rows):
    """Per quantity and pair of implementations only the worst (quantity, value, who),
    in order of first appearance: source and target, and all schemes, share a line."""
    worst = {}
    for quantity, who, value in rows:
        key = quantity, who.split(",")[0]
        if key not in worst or not value <= worst[key][0]:
            worst[key] = (value, who)
    for (quantity, _), (value, who) in sorted_by_quantity(worst):
        yield quantity, float(value), who


def sorted_by_quantity(worst):
    """Lines of one quantity together, quantities as first seen."""
    order = {}
    for quantity, _ in worst:
        order.setdefault(quantity, len(order))
    return sorted(worst.items(), key=lambda entry: order[entry[0][0]])
