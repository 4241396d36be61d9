"""Times of calls: one of a call, the shortest of several in turn, and how a time is printed."""

import time


def timed(call):
    """Seconds that the call takes, and what it returns."""
    begun = time.perf_counter()
    answer = call()
    return time.perf_counter() - begun, answer


def shortest(*calls, rounds=3, budget=20.0):
    """Shortest time of each call in seconds, run in turn, and what each returned last. No
    call takes more than about `budget` seconds in all."""
    times, answers = [float("inf")] * len(calls), [None] * len(calls)
    spent = [0.0] * len(calls)
    for _ in range(rounds):
        for at, call in enumerate(calls):
            if spent[at] > budget:
                continue
            took, answers[at] = timed(call)
            times[at], spent[at] = min(times[at], took), spent[at] + took
    return times, answers


def in_words(seconds):
    if seconds >= 1.0:
        return f"{seconds:.2f} s"
    return f"{1e3 * seconds:.2f} ms" if seconds >= 1e-3 else f"{1e6 * seconds:.1f} us"
