"""Add the checkout to `sys.path`, because the benchmarks are not installed."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT)]
