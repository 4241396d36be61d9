"""The crate's methods beside their best-known implementations, on the same clouds.

A module a method; each has `rows(scope)`, which yields `rule_table.Row`s and says in one
line what it leaves out because a peer is not installed.
"""
