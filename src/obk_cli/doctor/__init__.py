"""What `obk doctor` finds out about a machine: measured facts in, findings with cures out."""
