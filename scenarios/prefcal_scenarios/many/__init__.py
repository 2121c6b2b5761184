"""Run many experiments of one scenario on all cores.

`simulate` checks what it is given and puts results in order, `task` is how one θ runs, and what
the workers of `prefcal_env.workers` are told.
"""
