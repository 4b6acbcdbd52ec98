"""Adds this folder to the import path of the tests, so that they need no installation.

Messages of the workspace are imported from the folder of `obk build`.
"""

import sys
from pathlib import Path

PYTHON = f"python{sys.version_info.major}.{sys.version_info.minor}"

for folder in Path(__file__).resolve().parents:
    overlay = folder / ".obk" / "overlay" / "lib" / PYTHON / "site-packages"
    if overlay.is_dir():
        sys.path.insert(0, str(overlay))
        break
