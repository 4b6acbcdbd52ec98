"""A robot of one motor whose drive is spoken to over UDP."""
