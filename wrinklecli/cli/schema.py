"""`wrinkle schema`."""

import json
from typing import Any

import click

from wrinklecli.cli import options as opt
from wrinklecli.cli.output import write_text
from wrinklecli.cli.streams import command_outputs


@click.command(
    short_help="Print the JSON Schema of the tools file.", epilog="Example: wrinkle schema -o tools.schema.json"
)
@opt.file("--read", "tools", metavar="TOOLS", text="Print this tools file as JSON instead, if it is valid.")
@opt.file("-o", "--output", default="-", text="Write here; - is standard output.")
def schema(tools: str | None, output: str) -> None:
    """Print the JSON Schema of the tools file, for editors that complete and check YAML.

    If an editor has a YAML language server, this comment at the top of a tools file makes use of it:
    `# yaml-language-server: $schema=tools.schema.json`

    --read is for programs that read no YAML: it prints the keys that TOOLS gives, as it gives them, without defaults.

    Exit codes: 0 done; 1 FILE cannot be written, or TOOLS is at fault; 2 wrong usage; 70 a bug.
    """
    with command_outputs() as outputs:
        from wrinklecli.tools.schema import TOOLS_SCHEMA

        values: Any = TOOLS_SCHEMA
        if tools is not None:
            from wrinklecli.tools.read import given_values

            values, inputs = given_values(tools)
            outputs.protect(inputs)
        write_text(output, json.dumps(values, indent=2, ensure_ascii=False) + "\n", outputs)
