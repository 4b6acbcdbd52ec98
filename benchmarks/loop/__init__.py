"""Compare the cost and the timing accuracy of a control loop on several executors.

Run `python -m benchmarks.loop` from the root of the checkout. `cases` defines what is measured,
`run` starts the processes of one case and measures them from outside, `suite` runs the cases in
turns, `figures` computes the measures, `report` and `plots` write them.

The nodes run in separate processes (`worker`, or `benchmarks/floor` in C) and only record times;
this process computes the measures of all contestants in the same way.
"""
