"""Facts about the config language that the tool and the runtime library share.

They include message and component names, the table of sensor groups, checks of a `sim` block, and
the protocol between the tool and running nodes. This package needs only the standard library and
PyYAML. It reads no files or topics on its own.
"""
