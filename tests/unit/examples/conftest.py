"""Make the modules of the hardware example importable, as its programs import them."""

import importlib.util
import sys
from pathlib import Path

HARDWARE = Path(__file__).resolve().parents[3] / "examples" / "hardware"

sys.path.insert(0, str(HARDWARE / "src" / "udp_motor_robot"))
# Do not add the folder, because its demo.py would shadow other modules of that name.
spec = importlib.util.spec_from_file_location("device", HARDWARE / "device.py")
assert spec is not None
assert spec.loader is not None
sys.modules["device"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(sys.modules["device"])
