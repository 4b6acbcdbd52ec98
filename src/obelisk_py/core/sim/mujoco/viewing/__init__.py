"""Looking at a simulation, from processes of their own that are fed with its states.

Drawing never slows stepping: the stepping thread only hands over states and never waits
(`states`). An onlooker is a process below the robot's, niced below it (`child` starts it, `program`
is what runs in it), that gets the model as it was compiled and then states until the robot ends.

To add a kind of onlooker: a module here with the function `look(states, tell, arguments)`, a line
in `program.KINDS`, and in `onlookers` the ROS parameters that ask for it. Several may look at once.
"""
