"""`wrinkle schema`."""

import json

import click

from wrinklecli.cli import options as opt
from wrinklecli.cli.output import write_text
from wrinklecli.cli.streams import command_outputs


@click.command(
    short_help="Print the JSON Schema of the tools file.", epilog="Example: wrinkle schema -o tools.schema.json"
)
@opt.file("-o", "--output", default="-", text="Write here; - is standard output.")
def schema(output: str) -> None:
    """Print the JSON Schema of the tools file, for editors that complete and check YAML.

    If an editor has a YAML language server, this comment at the top of a tools file makes use of it:
    `# yaml-language-server: $schema=tools.schema.json`

    Exit codes: 0 done; 1 FILE cannot be written; 2 wrong usage; 70 a bug.
    """
    with command_outputs() as outputs:
        from wrinklecli.tools.schema import TOOLS_SCHEMA

        write_text(output, json.dumps(TOOLS_SCHEMA, indent=2, ensure_ascii=False) + "\n", outputs)
