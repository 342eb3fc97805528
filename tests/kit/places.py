"""Where tests find the repository's files, and a folder for what this process makes, removed at its end."""

import atexit
import shutil
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT / "samples"
FOLDER = Path(tempfile.mkdtemp(prefix="wrinkle-tests-"))
atexit.register(shutil.rmtree, FOLDER, ignore_errors=True)
