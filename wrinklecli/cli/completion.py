"""`wrinkle completion`."""

import os
from pathlib import Path

import click

from wrinklecli.cli import options as opt
from wrinklecli.cli.output import say
from wrinklecli.cli.streams import command_outputs
from wrinklecli.errors import BakeError
from wrinklecli.files.outputs import Outputs

SHELLS = ("bash", "zsh", "fish")
_VARIABLE = "_WRINKLE_COMPLETE"  # as click names it after the command
_LARGEST = 1 << 20  # bytes of a start file of zsh that is read


@click.command(
    short_help="Complete commands and options in a shell.",
    epilog="Example: wrinkle completion --install",
)
@click.argument("shell", required=False, type=click.Choice(SHELLS))
@opt.flag("--install", text="Write the script where the shell finds it, in place of printing it.")
def completion(*, shell: str | None, install: bool) -> None:
    """Print a script that lets a shell complete commands, options and file names, or install it.

    SHELL is the one that $SHELL names if it is left out. --install writes one file: for bash and fish into the folder
    of their completions below the home folder; for zsh beside them, with a line in ~/.zshrc that reads it. Bash needs
    version 4.4 and the package bash-completion, which most systems have.

    Exit codes: 0 done; 1 a file cannot be written; 2 wrong usage; 70 a bug.
    """
    chosen = shell or _shell()
    if not install:
        click.echo(_script(chosen))
        return
    with command_outputs() as outputs:
        written = _install(chosen, outputs)
    for path in written:
        say(f"written: {path}")
    say(f"Start a new {chosen} to complete wrinkle.")


def _shell() -> str:
    """The shell of the user.

    Raises:
        click.UsageError: It is not one that can complete.
    """
    name = os.path.basename(os.environ.get("SHELL", ""))
    if name not in SHELLS:
        raise click.UsageError(f"$SHELL names {name or 'no shell'}: say which, one of {', '.join(SHELLS)}.")
    return name


def _script(shell: str) -> str:
    """The script, by click."""
    from click.shell_completion import get_completion_class

    from wrinklecli.cli import cli

    kind = get_completion_class(shell)
    assert kind is not None, "each of SHELLS is one of click's"
    # `source` would start a bash to learn its version, and fail where there is none.
    complete = kind(cli, {}, "wrinkle", _VARIABLE)
    return complete.source_template % complete.source_vars()


def _install(shell: str, outputs: Outputs) -> list[Path]:
    """Write the script, and give the files that were written.

    Raises:
        BakeError: A file cannot be written, or `.zshrc` cannot be read.
    """
    home = Path.home()
    data = Path(os.environ.get("XDG_DATA_HOME") or home / ".local" / "share")
    configs = Path(os.environ.get("XDG_CONFIG_HOME") or home / ".config")
    script = {
        "bash": Path(os.environ.get("BASH_COMPLETION_USER_DIR") or data / "bash-completion")
        / "completions"
        / "wrinkle",
        "zsh": data / "wrinkle" / "completion.zsh",
        "fish": configs / "fish" / "completions" / "wrinkle.fish",
    }[shell]
    outputs.make_folders(script.parent)
    outputs.add_bytes(script, _script(shell).encode())
    if shell != "zsh":
        return [script]
    start = Path(os.environ.get("ZDOTDIR") or home) / ".zshrc"
    # The functions of completion are loaded by `compinit`, which may stand nowhere in the file.
    line = f"(( $+functions[compdef] )) || {{ autoload -Uz compinit; compinit }}; source {_quoted(script)}\n"
    old = _read(start)
    if line.encode() in old:
        return [script]
    outputs.add_bytes(start, old + (b"\n" if old and not old.endswith(b"\n") else b"") + line.encode(), last=True)
    return [script, start]


def _quoted(path: Path) -> str:
    import shlex

    return shlex.quote(str(path))


def _read(path: Path) -> bytes:
    """The content of a start file; empty if there is none.

    Raises:
        BakeError: It is no file, or too large.
    """
    from wrinklecli.files.inputs import open_input

    if not path.exists():
        return b""
    try:
        with open_input(path) as file:
            content = file.read(_LARGEST + 1)
    except OSError as error:
        raise BakeError(f"cannot be read: {error.strerror}", where=str(path)) from error
    if len(content) > _LARGEST:
        raise BakeError("has more than 1 MB, so no line is added to it", where=str(path))
    return content
