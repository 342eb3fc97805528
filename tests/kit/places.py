"""Where tests find the repository's files, and folders for what a run of tests makes, removed at its end."""

import atexit
import os
import shutil
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT / "samples"
IN_CI = os.environ.get("CI", "").lower() in ("1", "true")

_VARIABLE = "WRINKLE_TESTS_FOLDER"
# The first process of a run makes the folder, and its workers find it. Runs that are given one share what is in it.
if _VARIABLE not in os.environ:
    os.environ[_VARIABLE] = tempfile.mkdtemp(prefix="wrinkle-tests-")
    atexit.register(shutil.rmtree, os.environ[_VARIABLE], ignore_errors=True)
SHARED = Path(os.environ[_VARIABLE])
# The user's own folder for settings stays as it is.
SETTINGS = SHARED / "settings"
os.environ["XDG_CONFIG_HOME"] = str(SETTINGS)
FOLDER = Path(tempfile.mkdtemp(dir=SHARED))  # of this process alone
