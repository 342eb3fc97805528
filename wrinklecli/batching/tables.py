"""Read manifests that are tables, with a job in each line: CSV with a row of keys, and JSON lines."""

import csv
import io
import json
import re
from typing import Any

from wrinklecli.batching.manifest_schema import JOB_KEYS, MAX_JOBS
from wrinklecli.tools.yaml_tree import Node, Problem, printable, tree_of

_SEPARATOR = ";"  # between the items of a list in a cell
_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?")


def read_csv(text: str) -> tuple[Node | None, list[Problem]]:
    """Read a CSV file. Semicolons separate the items of a list; an empty cell leaves its key unset."""
    jobs: list[Node] = []
    problems: list[Problem] = []
    rows = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        keys = [cell.strip() for cell in next(rows)]
        if len(set(keys)) < len(keys):
            return None, [Problem(1, "", "two columns have the same key")]
        for number, row in enumerate(rows):
            line = rows.line_num
            if number == MAX_JOBS:
                return None, [Problem(line, "", f"found more rows, expected at most {MAX_JOBS:,} jobs")]
            if len(row) > len(keys):
                problems.append(Problem(line, "", f"found {len(row)} cells, expected at most {len(keys)}"))
            cells = zip(keys, row, strict=False)
            values = {key: _cell(key, cell.strip()) for key, cell in cells if cell.strip()}
            if values:
                jobs.append(tree_of(values, line))
    except csv.Error as error:
        return None, [Problem(rows.line_num, "", f"CSV: {error}")]
    return _tree(jobs) if jobs or not problems else None, problems


def read_json_lines(text: str) -> tuple[Node | None, list[Problem]]:
    """Read a file with a JSON object in each line; empty lines are skipped."""
    jobs: list[Node] = []
    problems: list[Problem] = []
    lines = [(line, each) for line, each in enumerate(text.split("\n"), start=1) if each.strip()]
    if len(lines) > MAX_JOBS:
        return None, [Problem(lines[MAX_JOBS][0], "", f"found more lines, expected at most {MAX_JOBS:,} jobs")]
    for line, each in lines:
        try:
            value = json.loads(each, parse_constant=refuse_constant)
            json.dumps(value, ensure_ascii=False).encode()
        except (ValueError, RecursionError) as error:
            reason = getattr(error, "msg", None) or str(error)
            if isinstance(error, RecursionError):
                reason = "nested deeper than any job"
            elif isinstance(error, UnicodeEncodeError):  # JSON writes half of a character as an escape
                reason = f"\\u{ord(error.object[error.start]):04x} is half of a character"
            problems.append(Problem(line, "", f"JSON: {printable(reason, 80)}"))
            continue
        jobs.append(tree_of(value, line))
    return _tree(jobs) if jobs or not problems else None, problems


def refuse_constant(name: str) -> Any:
    """Raise ValueError for NaN or an infinity, which Python's parser of JSON would take."""
    raise ValueError(f"{name} is no number in JSON")


def _tree(jobs: list[Node]) -> Node:
    listed = Node([each.value for each in jobs], 1, f"a list of {len(jobs)}", dict(enumerate(jobs)))
    version = Node(1, 1, "1", {})
    return Node({"version": 1, "jobs": listed.value}, 1, "a mapping", {"version": version, "jobs": listed})


def _cell(key: str, text: str) -> Any:
    """Convert a cell to the type of its key."""
    kinds = JOB_KEYS.get(key, {}).get("type", "string")
    if "array" in kinds:
        return [part.strip() for part in text.split(_SEPARATOR) if part.strip()]
    if kinds == "boolean" and text.lower() in ("true", "false"):
        return text.lower() == "true"
    if _NUMBER.fullmatch(text) and ("number" in kinds or kinds == "integer"):
        return int(text) if re.fullmatch(r"[-+]?\d{1,18}", text) else float(text)
    return text
