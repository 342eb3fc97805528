"""`wrinkle` run in this process as from a shell, and `make` in the samples."""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from wrinklecli import cli


@dataclass(frozen=True)
class Ran:
    """What a run of `wrinkle` did."""

    code: int
    out: str
    lines: list[str]


class Wrinkle:
    """Runs the command in this process, in a folder of its own."""

    def __init__(self, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        self._capfd, self._monkeypatch = capfd, monkeypatch

    def __call__(self, *arguments: str | Path) -> Ran:
        self._monkeypatch.setattr(sys, "argv", ["wrinkle", *map(str, arguments)])
        self._capfd.readouterr()
        code: Any = 0
        try:
            cli.main()
        except SystemExit as exit_:
            code = exit_.code or 0
        captured = self._capfd.readouterr()
        return Ran(code, captured.out, captured.err.splitlines())


def files(folder: Path) -> dict[str, bytes]:
    """The content of every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def make_samples(samples: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run `make` in a copy of the folder of samples, with the `wrinkle` and the Python of these tests."""
    environment = os.environ | {"WRINKLE": str(Path(sys.executable).with_name("wrinkle")), "PYTHON": sys.executable}
    return subprocess.run(
        ["make", "-C", str(samples), *arguments], env=environment, check=True, capture_output=True, text=True
    )
