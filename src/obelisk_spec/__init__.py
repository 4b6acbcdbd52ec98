"""Facts of the language that the tool and the run time share.

Message names, component identity, the sensor table, names that ROS takes, model checks.
Needs only the standard library and PyYAML; never reads a file and never talks to ROS.
"""
