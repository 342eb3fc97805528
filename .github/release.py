"""Makes a checkout ready to be released: links that a package registry can follow, and man pages.

Usage: python .github/release.py REPOSITORY TAG

REPOSITORY is the address of the project on its host, without a slash at its end; TAG is `v` and the version of
`pyproject.toml`. The script writes into the checkout in which it lies, so run it in one that is thrown away; then
`python -m build`. Needs this package and those of `.github/requirements.txt`.
"""

import re
import sys
import tomllib
from pathlib import Path

from click_man.core import write_man_pages

from wrinklecli.cli import cli

ROOT = Path(__file__).resolve().parents[1]
LINK = re.compile(r"(!?\[[^]]*\])\((?![a-z]+:|#)([^)\s]+)\)")


def absolute(text: str, repository: str, tag: str) -> str:
    """A page whose relative links name the files of a tag: pictures as they are, other files as pages of the host."""
    return LINK.sub(lambda m: f"{m[1]}({repository}/{'raw' if m[1][0] == '!' else 'blob'}/{tag}/{m[2]})", text)


def urls(repository: str, tag: str) -> str:
    """The table `project.urls` of pyproject.toml."""
    links = {
        "Homepage": repository,
        "Documentation": f"{repository}/blob/{tag}/README.md",
        "Changelog": f"{repository}/blob/{tag}/CHANGELOG.md",
        "Issues": f"{repository}/issues",
        "Source": repository,
    }
    return "\n[project.urls]\n" + "".join(f'{name} = "{link}"\n' for name, link in links.items())


def main(repository: str, tag: str) -> None:
    """Prepare the checkout.

    Raises:
        SystemExit: The tag is not that of the version in pyproject.toml.
    """
    project, readme = ROOT / "pyproject.toml", ROOT / "README.md"
    settings = project.read_text(encoding="utf-8")
    version = tomllib.loads(settings)["project"]["version"]
    if tag != f"v{version}":
        raise SystemExit(f"release.py: the tag is {tag}, but pyproject.toml has version {version}")
    project.write_text(settings + urls(repository, tag), encoding="utf-8")
    readme.write_text(absolute(readme.read_text(encoding="utf-8"), repository, tag), encoding="utf-8")
    pages = ROOT / ".github" / "man"  # what lies in `build` is left out of an sdist
    pages.mkdir(exist_ok=True)
    write_man_pages("wrinkle", cli, version=version, target_dir=str(pages))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        raise SystemExit("Usage: python .github/release.py REPOSITORY TAG")
    main(sys.argv[1].rstrip("/"), sys.argv[2])
