"""Troubles the dummy stack for a long time, and looks whether anything of it grows or is left.

`make bench PART=soak` from the root of the checkout. `plan` says what is done in which order,
`troubles` does it and holds the answers against the rules, `stack` is what it is done to, `counts`
counts and judges growth, `rates` judges rates against what a bare timer keeps, `results`
keeps and draws; `rounds` is a program of its own. What is judged is the stack's: time that the
machine's host takes, or that other work takes, makes a second void, and is reported.
"""
