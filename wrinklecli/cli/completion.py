"""`wrinkle completion`."""

import click

_VARIABLE = "_WRINKLE_COMPLETE"  # as click names it after the command


@click.command(
    short_help="Print a script that completes commands and options in a shell.",
    epilog="Example: wrinkle completion bash",
)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(*, shell: str) -> None:
    """Print a script that lets a shell complete commands, options and file names.

    Save it where new shells find it (bash needs version 4.4 and the package bash-completion, zsh compinit):

    \b
    bash  ~/.local/share/bash-completion/completions/wrinkle
    zsh   a folder of $fpath, as _wrinkle
    fish  ~/.config/fish/completions/wrinkle.fish

    Exit codes: 0 done; 2 wrong usage; 70 a bug.
    """  # noqa: D301
    from click.shell_completion import get_completion_class

    from wrinklecli.cli import cli

    kind = get_completion_class(shell)
    assert kind is not None, "click knows each of the shells"
    # `source` would start a bash to learn its version, and fail where there is none.
    complete = kind(cli, {}, "wrinkle", _VARIABLE)
    click.echo(complete.source_template % complete.source_vars())
