"""Everything that runs other people's programs: the crate beside its peers.

`programs` runs them, a module a program. The rest compares: `methods` method by method,
`paper_trials` on the trials of the paper's tables, `benchmark` and `throughput` on real pairs,
`speed` stage by stage, `loops` without any reference pose; `tutorial` is a lesson.
"""
