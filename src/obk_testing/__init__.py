"""Closed-loop tests of a config: its nodes run in lockstep, in one process, from pytest."""

from obk_testing.result import TrialResult
from obk_testing.topic_log import TopicLog
from obk_testing.trial import StackTrial

__all__ = ["StackTrial", "TopicLog", "TrialResult"]
