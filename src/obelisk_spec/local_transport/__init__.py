"""Local transport: code shared by the subscriptions of a run and the tool's taps.

A subscription listens on a Unix socket in the run's private folder, which is named after its GID,
and publishers connect to it. `sockets` opens and checks sockets and defines their packets.
`dds_reader` takes messages from DDS. `inbox` merges both into the order of publishing.
"""
