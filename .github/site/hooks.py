"""Gives mkdocs this repository's pages, one for each part of the schema and one that plays the demo, without copies.

The player needs three.js (`npm ci --prefix tests/clients`) and the demo (`wrinkle demo`); without them there is none.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files

ROOT = Path(__file__).resolve().parents[2]
LINK = re.compile(r"\]\(([^)#\s]+)(#[^)\s]*)?\)")
LINE = "| `{}` | {} | {} | {} |"
PLAYER = ROOT / "samples" / "driver"
DEMO = ROOT / "wrinkle-demo" / "wrinkled.glb"
THREE = (ROOT / "tests" / "clients" / "node_modules" / "three").resolve()
IMPORT = re.compile(r"""^\s*(?:import|export|\}).* from ['"]([./]?[^'"]+)['"]""", re.MULTILINE)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Name the player beside the pages."""
    if _plays():
        config.nav.insert(1, {"Play": "play/index.html"})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the navigation, and each file of the repository that one of them links to."""
    wanted = [name for name in _leaves(config.nav) if (ROOT / name).is_file()]
    for name in wanted:  # grows while pages are read
        if not name.endswith(".md"):
            _add(files, config, name, (ROOT / name).read_bytes())
            continue
        text = (ROOT / name).read_text(encoding="utf-8")
        _add(files, config, name, _within_site(text, name))
        for link, _ in LINK.findall(text):
            linked = ((ROOT / name).parent / link).resolve()
            if linked.is_file() and linked.is_relative_to(ROOT):
                found = linked.relative_to(ROOT).as_posix()
                wanted += [found] if found not in wanted else []
    if _plays():
        for name, content in player(DEMO):
            _add(files, config, name, content)
    _add(files, config, "schema.md", schema_page(json.loads((ROOT / "configs/schema.json").read_bytes())))
    return files


def _plays() -> bool:
    return DEMO.is_file() and THREE.is_dir()


def player(figure: Path) -> Iterator[tuple[str, bytes]]:
    """The page that plays a bake, with a figure, and the modules that it imports, directly or not: names, contents."""
    page = (PLAYER / "index.html").read_text(encoding="utf-8")
    page = page.replace("./node_modules/three", "./three").replace("../../wrinkle-demo/wrinkled.glb", "figure.glb")
    page = page.replace(" (npm install brings three.js)", "")
    yield "play/index.html", page.encode()
    yield "play/figure.glb", figure.read_bytes()
    named = {"three": THREE / "build" / "three.module.js"}
    wanted = [PLAYER / "index.html"]
    for path in wanted:  # grows while modules are read
        for name in IMPORT.findall(path.read_text(encoding="utf-8")):
            addon = THREE / "examples" / "jsm" / name.removeprefix("three/addons/")
            found = named.get(name) or (addon if name.startswith("three/") else (path.parent / name).resolve())
            if found not in wanted:
                wanted.append(found)
                three = found.is_relative_to(THREE)
                place = Path("three", found.relative_to(THREE)) if three else found.relative_to(PLAYER)
                yield f"play/{place.as_posix()}", found.read_bytes()


def _leaves(nav: Any) -> list[str]:
    """The pages of a navigation, at any depth."""
    if isinstance(nav, str):
        return [nav]
    return [page for each in (nav.values() if isinstance(nav, dict) else nav) for page in _leaves(each)]


def _add(files: Files, config: MkDocsConfig, name: str, content: str | bytes) -> None:
    from mkdocs.structure.files import File, InclusionLevel

    if files.get_file_from_path(name) is None:
        file = File.generated(config, name, content=content)
        file.inclusion = InclusionLevel.INCLUDED  # by default what begins with a dot is left out
        files.append(file)


def _within_site(text: str, name: str) -> str:
    """A page whose links to folders lead nowhere: a site has no listing of files."""

    def kept(match: re.Match[str]) -> str:
        return "]()" if ((ROOT / name).parent / match[1]).is_dir() else match[0]

    # `[text]()` would still be a link, so its brackets go too.
    return re.sub(r"\[([^][]*)\]\(\)", r"\1", LINK.sub(kept, text))


def schema_page(schema: dict[str, Any]) -> str:
    """A table of the keys of each part of a tools file, from its JSON Schema."""
    parts = [("The file", schema["properties"])]
    for key, part in schema["properties"].items():
        inner = part.get("items", part).get("properties", {})
        if inner:
            parts.append((f"{key}", inner))
    lines = [
        "# Keys of a tools file",
        "",
        "`wrinkle schema` prints these as JSON Schema, from which editors complete keys.",
    ]
    for title, keys in parts:
        lines += ["", f"## {title}", "", "| key | value | default | meaning |", "|---|---|---|---|"]
        lines += [
            LINE.format(key, _value(each), _default(each), _cell(each.get("description", "")))
            for key, each in keys.items()
        ]
    return "\n".join(lines) + "\n"


def _value(each: dict[str, Any]) -> str:
    if "errorMessage" in each:
        return _cell(str(each["errorMessage"]).removeprefix("expected "))
    kinds = each.get("type", [])
    # Editors of YAML call a JSON object a mapping.
    named = ["a mapping" if kind == "object" else str(kind) for kind in ([kinds] if isinstance(kinds, str) else kinds)]
    return " or ".join(named)


def _default(each: dict[str, Any]) -> str:
    return f"`{json.dumps(each['default'])}`" if each.get("default") is not None else ""


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
