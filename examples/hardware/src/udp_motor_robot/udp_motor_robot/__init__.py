"""A robot node for one motor whose drive is connected over UDP."""
