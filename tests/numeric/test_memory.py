"""The memory that is free is read from the files of a system."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from wrinklecli.errors import BakeError
from wrinklecli.numeric import memory
from wrinklecli.numeric.arrays import unit
from wrinklecli.numeric.guard import guarded
from wrinklecli.numeric.memory import allowed_memory, available_memory, default_memory, held, parse_bytes

MACHINE = {"proc/meminfo": "MemTotal: 16000000 kB\nMemAvailable:   8000000 kB\n"}
GB = 10**9


def group(folder: str, most: object, taken: int, kept: int) -> dict[str, str]:
    """The files of a control group; those of version 1 are below `memory`."""
    names = ("memory.max", "memory.current", "")
    if folder.startswith("memory"):
        names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_")
    where = f"sys/fs/cgroup/{folder}".rstrip("/")
    return {
        f"{where}/{names[0]}": f"{most}\n",
        f"{where}/{names[1]}": f"{taken}\n",
        f"{where}/memory.stat": f"anon 1\n{names[2]}inactive_file {kept}\n",
    }


@pytest.mark.parametrize(
    ("files", "free"),
    [
        (MACHINE, 8_192_000_000),
        ({**MACHINE, "proc/self/cgroup": "0::/a/b\n", **group("a/b", "max", GB, 0)}, 8_192_000_000),
        ({**MACHINE, "proc/self/cgroup": "0::/a/b\n", **group("a/b", 4 * GB, 3 * GB, 2 * GB)}, 3 * GB),
        ({**MACHINE, "proc/self/cgroup": "0::/a/b\n", **group("a", 4 * GB, GB, 0), **group("a/b", "max", 0, 0)}, 3 * GB),  # noqa: E501
        ({**MACHINE, "proc/self/cgroup": "0::/not/shown/here\n", **group("", 2 * GB, 0, 0)}, 2 * GB),
        ({**MACHINE, "proc/self/cgroup": "0::/\n", **group("", 2 * GB, 3 * GB, 0)}, 0),
        ({**MACHINE, "proc/self/cgroup": "3:cpu:/a\n9:memory:/a\n", **group("memory/a", 5 * GB, GB, GB)}, 5 * GB),
        ({**MACHINE, "proc/self/cgroup": "9:memory:/\n", **group("memory", 2**63 - 4096, GB, 0)}, 8_192_000_000),
    ],
)  # fmt: skip
def test_free_is_what_the_machine_and_all_groups_leave(tmp_path: Path, files: dict[str, str], free: int) -> None:
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert available_memory(str(tmp_path)) == free


@pytest.mark.parametrize("physical", [None, 6 * GB])
def test_a_system_without_these_files_tells_of_its_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, physical: int | None
) -> None:
    monkeypatch.setattr(memory, "physical_memory", lambda: physical)
    assert available_memory(str(tmp_path)) == physical


@pytest.mark.parametrize(("free", "most"), [(None, GB), (0, GB), (GB, GB), (6 * GB, 3 * GB)])
def test_half_of_it_may_be_taken_and_at_least_1_gb(
    monkeypatch: pytest.MonkeyPatch, free: int | None, most: int
) -> None:
    monkeypatch.setattr(memory, "available_memory", lambda: free)
    assert default_memory() == most


@pytest.mark.skipif(sys.platform != "linux", reason="the system must limit the process")
def test_an_array_that_does_not_fit_is_refused_before_it_is_filled_and_said() -> None:
    """The line has the step, its need, the limit and the option."""
    with pytest.raises(BakeError) as refused, held(200 * 10**6), guarded("a.glb"):
        unit(np.broadcast_to(np.ones(3), (10**8, 3)))
    (line,) = refused.value.lines
    assert re.fullmatch(
        r"a\.glb: takes more memory than there is, or than --max-memory allows \(200 MB\):"
        r" unit \(numeric/arrays\.py:\d+\) needs 800 MB more",
        line,
    )
    assert allowed_memory() is None


@pytest.mark.parametrize(
    "said",
    ["a.so: cannot map zero-fill pages", "a.so: failed to map segment from shared object", "No module named 'a'"],
)
def test_a_library_that_cannot_be_loaded_for_want_of_memory_is_said(said: str) -> None:
    with pytest.raises((BakeError, ImportError)) as raised, guarded("a.glb"):
        raise ImportError(said)
    assert ("takes more memory" in str(raised.value)) == ("map" in said)


@pytest.mark.parametrize(("text", "size"), [("900kB", 900_000), ("1.5 mb", 1_500_000), ("2GB", 2_000_000_000)])
def test_sizes_are_read_as_they_are_shown(text: str, size: int) -> None:
    assert parse_bytes(text, least=1) == size
    with pytest.raises(ValueError, match="is no size from 50 MB up"):
        parse_bytes("900kB")
