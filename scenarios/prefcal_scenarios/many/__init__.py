"""Run many experiments of one scenario on all cores.

`simulate` checks what it is given, `dispatch` hands θ to worker processes and puts results in
order, `inside` is what a worker does, and `task` is how it runs one θ.
"""
