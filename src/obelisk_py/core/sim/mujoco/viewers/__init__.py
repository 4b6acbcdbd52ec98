"""Show a simulation in viewers, which run in separate processes and receive its states.

Rendering never slows down stepping: the stepping thread only sends states and never waits
(`viewer_messages`). A viewer is a child process of the robot with a lower priority. `processes`
starts it and `program` runs in it. It receives the compiled model, and then states until the robot
ends.

To add a kind of viewer, add a module here with a function `run(states, notify, arguments)`, a line
in `program.VIEWER_KINDS`, and in `processes` the ROS parameters that select it. Several viewers may
run at the same time.
"""
