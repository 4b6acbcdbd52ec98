"""Viewers of a simulation, in processes of their own that receive its states.

Drawing never slows stepping: the stepping thread only sends states and never waits
(`viewer_messages`). A viewer is a process below the robot's, niced below it (`processes` starts it,
`program` runs in it), which gets the compiled model and then states until the robot ends.

To add a kind of viewer: a module here with a function `run(states, notify, arguments)`, a line in
`program.VIEWER_KINDS`, and in `processes` the ROS parameters that select it. Several may run at
once.
"""
