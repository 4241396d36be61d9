"""Small solved cases, a module a story: each has `cases()`, a dict of folder name to
(input, expected), made of dicts, lists, numbers and arrays."""
