"""Inject faults into the dummy stack for a long time, and check for leaks and leftovers.

Run `make bench PART=soak` from the root of the checkout. `plan` decides the order of faults,
`troubles` injects them and checks the outcome, `stack` runs the stack, `counts` measures and judges
growth, `rates` judges rates next to a bare timer, and `results` writes and plots; `rounds` is a
separate program. A second in which the machine's host or other load takes too much CPU time is
void, and reported.
"""
