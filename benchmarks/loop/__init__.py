"""What a control loop costs and how exactly it keeps time, on several executors side by side.

`python -m benchmarks.loop` from the root of the checkout. A `cases` says what is measured, a `run`
starts the processes of one case and measures them from outside, `suite` takes the cases in turns,
`figures` makes numbers of what came out, `report` and `plots` write them down.

The nodes run in processes of their own (`worker`, or `benchmarks/floor` in C). They only note when
something happened; what follows from it is computed here, the same way for all.
"""
