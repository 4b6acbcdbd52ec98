"""Which files of a test count as its inputs."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import json, sys
from pathlib import Path

sys.path[:0] = sys.argv[1:]
from obk_testing.sweep.files_read import FilesRead

files = FilesRead([Path(sys.argv[1])])
import user
user.first()
first = files.take()
user.second()
print(json.dumps([first, files.take()]))
"""
USER = """
import os
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
np.save(HERE / "written.npy", np.zeros(3))


def first():
    import later
    np.loadtxt(HERE / "table.csv")
    np.load(HERE / "written.npy")
    (HERE / "build" / "log.txt").read_text()
    os.close(os.open(HERE / "table.csv", os.O_RDONLY))
    Path("/proc/self/stat").read_bytes()


def second():
    os.chdir(HERE)
    open("data/gains.txt").close()
    np.loadtxt(HERE / "table.csv")
"""


@pytest.mark.parametrize("run", ["first import", "compiled before"])
def test_files_that_user_code_reads_but_does_not_write_are_found(tmp_path: Path, run: str) -> None:
    (tmp_path / "user.py").write_text(USER)
    (tmp_path / "later.py").touch()
    (tmp_path / "table.csv").write_text("1 2\n")
    for folder, name in (("build", "log.txt"), ("data", "gains.txt")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / name).touch()
    for _ in range(2 if run == "compiled before" else 1):
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, str(tmp_path)],
            capture_output=True,
            text=True,
            check=True,
        )
    first, second = json.loads(done.stdout)
    assert first == [str(tmp_path / name) for name in ("later.py", "table.csv")]
    assert second == [str(tmp_path / "data" / "gains.txt")]
