"""Rows: both sides timed in turn, the shortest of each."""

import time


def shortest(*calls, rounds=3, budget=20.0):
    """Shortest time of each call in seconds, run in turn, and what each returned last. No
    call takes more than about `budget` seconds in all."""
    times, answers = [float("inf")] * len(calls), [None] * len(calls)
    spent = [0.0] * len(calls)
    for _ in range(rounds):
        for at, call in enumerate(calls):
            if spent[at] > budget:
                continue
            begun = time.perf_counter()
            answers[at] = call()
            took = time.perf_counter() - begun
            times[at], spent[at] = min(times[at], took), spent[at] + took
    return times, answers


def row(what, ours, theirs, peer, same):
    """Two times in seconds, and the ratio."""
    return f"{what:<46} {unit(ours):>9} {unit(theirs):>9} {theirs / ours:6.2f}x  {peer:<26} {same}"


def unit(seconds):
    if seconds >= 1.0:
        return f"{seconds:.2f} s"
    return f"{1e3 * seconds:.2f} ms" if seconds >= 1e-3 else f"{1e6 * seconds:.1f} us"
