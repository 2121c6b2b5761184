"""Run many experiments of one scenario on all cores.

`simulate` checks what it is given and puts results in order, `pool` hands θ to worker processes,
`inside` is what a worker does, and `task` is how it runs one θ.
"""
