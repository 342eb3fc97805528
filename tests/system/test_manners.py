"""What all commands have in common: help, options, exit codes, completion, streams."""

import os
import pty
import re
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import click
import pytest

from kit.limb import limb_asset, write_tools
from kit.places import ROOT
from kit.samples import PALM, sample
from kit.work import PATIENCE
from wrinklecli.cli import cli

COMMANDS = sorted(cli.commands)
README, OPTIONS_PAGE = (ROOT / "README.md").read_text(), (ROOT / "configs" / "bake.md").read_text()
MAIN = [sys.executable, "-c", "from wrinklecli.cli import main; main()"]


def options(name: str) -> dict[str, click.Option]:
    return {each.opts[-1]: each for each in cli.commands[name].params if isinstance(each, click.Option)}


def help_of(name: str) -> str:
    with click.Context(cli.commands[name], info_name=f"wrinkle {name}") as context:
        return cli.commands[name].get_help(context)


# --- Help ---


@pytest.mark.parametrize("name", COMMANDS)
def test_help_ends_with_an_example_and_names_the_exit_codes(name: str) -> None:
    lines = " ".join(help_of(name).split())
    assert "\\" not in lines, "an escape that click does not know"
    assert "Exit codes: 0 " in lines
    assert "70 a bug" in lines
    assert re.search(rf"Example: wrinkle {name} \S+.*$", lines)
    shown = cli.commands[name].get_short_help_str(60)
    assert not shown.endswith("...")


@pytest.mark.parametrize("name", COMMANDS)
def test_the_example_of_the_help_is_no_wrong_usage(name: str) -> None:
    example = " ".join(help_of(name).split()).rpartition(f"Example: wrinkle {name} ")[2].split()
    # Options are read and checked; the command itself is not run.
    cli.commands[name].make_context(name, example)


def test_options_of_one_name_are_of_one_kind() -> None:
    kinds: dict[str, dict[str, Any]] = {}
    for name in COMMANDS:
        for flag, option in options(name).items():
            described = (option.is_flag, option.multiple, type(option.type).__name__)
            kinds.setdefault(flag, {})[name] = described
    different = {flag: found for flag, found in kinds.items() if len(set(found.values())) > 1}
    assert not different
    for name in COMMANDS:
        short = {each for option in options(name).values() for each in option.opts if not each.startswith("--")}
        assert short <= {"-o", "-q", "-v", "-j"}


def test_the_pages_name_every_command_and_every_exit_code() -> None:
    shown = re.findall(r"^wrinkle (\w+) ", README, re.MULTILINE)
    assert shown == [
        *(
            "demo",
            "inspect",
            "suggest",
            "edit",
            "check",
            "bake",
            "maps",
            "preview",
            "diff",
            "track",
            "batch",
            "schema",
            "completion",
            "doctor",
        )
    ]
    assert set(COMMANDS) == set(shown)
    table = dict(re.findall(r"^\| (\d+) \| (.*) \|$", OPTIONS_PAGE, re.MULTILINE))
    assert sorted(table, key=int) == ["0", "1", "2", "3", "70"]
    for name in COMMANDS:
        text = " ".join((cli.commands[name].help or "").split())
        codes = re.findall(r"[:;] (\d+) ", text[text.index("Exit codes") :])
        assert {int(code) for code in codes} <= {0, 1, 2, 3, 70}
        assert ("3" in codes) == ("--strict" in options(name))
        assert ("3" in codes) == (f"`{name}`" in table["3"])


def test_the_readme_is_short() -> None:
    assert len(README.splitlines()) < 200


# --- Streams ---


@pytest.mark.slow
def test_a_reader_that_leaves_early_is_no_bug() -> None:
    read, write = os.pipe()
    os.close(read)
    ran = subprocess.run([*MAIN, "schema"], stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert ran.returncode == 1
    assert "Traceback" not in ran.stderr


@pytest.mark.slow
def test_names_that_the_terminal_cannot_show_are_escaped(tmp_path: Path) -> None:
    asset = limb_asset()
    asset.gltf["nodes"][0]["name"] = "額é"
    path = asset.write(tmp_path / "limb.glb")
    environment = {**os.environ, "PYTHONIOENCODING": "latin-1"}
    ran = subprocess.run([*MAIN, "inspect", str(path)], env=environment, capture_output=True, check=True)
    assert b"  \\u984d\xe9: skin 0\n" in ran.stdout


def start_on_terminal(command: list[str], **environment: str) -> tuple[subprocess.Popen[bytes], int]:
    """A process whose standard streams are a terminal, and the other end of that."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        command,
        cwd=ROOT,
        env={**os.environ, **environment},
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        start_new_session=True,
    )
    os.close(theirs)
    return process, ours


def read_until(terminal: int, wanted: bytes | None) -> str:
    """What is written to a terminal until some text is there, or until the process ends."""
    seen, end = b"", time.monotonic() + PATIENCE
    while time.monotonic() < end and (wanted is None or wanted not in seen):
        if select.select([terminal], [], [], 0.1)[0]:
            try:
                seen += os.read(terminal, 65536)
            except OSError:  # the other end is gone
                break
    return seen.decode()


def on_terminal(arguments: list[str], **environment: str) -> str:
    """What a command writes to a terminal that is its standard output and error."""
    process, terminal = start_on_terminal([*MAIN, *arguments], **environment)
    shown = read_until(terminal, None)
    assert process.wait() == 0
    os.close(terminal)
    return shown


@pytest.mark.slow
@pytest.mark.long
def test_colours_are_for_terminals_that_want_them(tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", {**PALM, "strength": 2})
    arguments = ["check", str(sample("wrist")), str(tools)]
    environment = {key: value for key, value in os.environ.items() if key != "NO_COLOR"}
    assert "\x1b[33mpalm" in on_terminal(arguments, NO_COLOR="")
    plain = on_terminal(arguments, NO_COLOR="1")
    assert "palm  wrist" in plain
    assert not re.search(r"\x1b\[\d+m", plain)
    piped = subprocess.run([*MAIN, *arguments], env=environment, capture_output=True, text=True, check=True)
    assert "\x1b" not in piped.stdout + piped.stderr


# --- Completion ---


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("wrinkle che", "wrinkle check "),
        ("wrinkle check samples/tro", "wrinkle check samples/trousers.glb "),
        ("wrinkle check --pl", "wrinkle check --plot "),
        ("wrinkle bake --engine uni", "wrinkle bake --engine unity "),
    ],
)
@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes(typed: str, completed: str, tmp_path: Path) -> None:
    script = tmp_path / "wrinkle"
    script.write_text(f"#!{MAIN[0]}\nfrom wrinklecli.cli import main\nmain()\n")
    script.chmod(0o755)
    printed = subprocess.run([*MAIN, "completion", "bash"], stdout=subprocess.PIPE, check=True).stdout
    (tmp_path / "completion").write_bytes(printed)
    line = f". {tmp_path}/completion"
    bash = ["bash", "--norc", "--noprofile", "-i"]
    process, terminal = start_on_terminal(bash, PATH=f"{tmp_path}:{os.environ['PATH']}", TERM="dumb")
    try:
        os.write(terminal, f"PS1=; {line}; echo rea''dy\n".encode())
        assert "ready\r\n" in read_until(terminal, b"ready\r\n")
        os.write(terminal, f"{typed}\t".encode())
        assert completed in read_until(terminal, completed.encode())
    finally:
        process.kill()
        process.wait()
        os.close(terminal)
