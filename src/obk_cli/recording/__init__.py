"""What a recording holds and which topics go into it; reads and writes no message itself."""
