"""Child processes: the warden, identity across reused numbers, signals, load, shared memory."""
