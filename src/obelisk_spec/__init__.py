"""Facts of the config language that the tool and the run time share.

Message and component names, the table of sensor groups, checks of a `sim` block, and the protocol
between the tool and running nodes. Needs only the standard library and PyYAML; reads no file and
no topic.
"""
