"""The hardware example's own modules, importable as its programs import them."""

import sys
from pathlib import Path

HARDWARE = Path(__file__).resolve().parents[3] / "examples" / "hardware"
sys.path[:0] = [str(HARDWARE), str(HARDWARE / "src" / "udp_motor_robot")]
