"""The benchmarks are no part of what is installed: their tests put the checkout on the path."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT)]
