"""Recordings: choose topics, write and read MCAP files, plot fields."""
