"""Child processes: the warden, identity across reused PIDs, signals, load, shared memory."""
