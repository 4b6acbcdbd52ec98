"""Fault injection for `obk rehearse`: delay, freeze and kill nodes, and check the reaction."""
