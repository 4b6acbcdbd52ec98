"""Facts of the config language that the tool and the run time share.

Message and component names, the table of sensor groups, checks of a `sim` block, and what the tool
and running nodes agree on. Needs the standard library and PyYAML only; reads no file and no topic.
"""
