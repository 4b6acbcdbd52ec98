"""Local transport: code shared by the subscriptions of a run and the tool's taps.

A subscription listens on a Unix socket, named after its GID, in the run's private folder.
Publishers connect to it. `sockets` opens and checks sockets and defines their packets. `dds_reader`
takes messages from DDS. `inbox` merges both into the order of publishing.
"""
