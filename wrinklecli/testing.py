"""A pytest plugin for golden tests: `wrinkle_golden` compares a file with its golden.

Installing wrinklecli registers the plugin. It imports nothing but pytest until a test uses it.

    def test_knee(wrinkle_golden, tmp_path):
        wrinklecli.bake("character.glb", "tools.yaml", tmp_path / "knee.glb")
        wrinkle_golden(tmp_path / "knee.glb", "goldens/knee.glb")

If the files differ, the test fails, and the file that was obtained stays beside the golden as `knee.obtained.glb`.
`pytest --wrinkle-update` makes this file the golden, and still fails the test, so that nobody accepts a golden unseen.
"""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from wrinklecli.gltf.document import Document
    from wrinklecli.tools.records import Length


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add `--wrinkle-update`."""
    group = parser.getgroup("wrinkle", "golden tests of glTF files (wrinklecli)")
    group.addoption(
        "--wrinkle-update",
        action="store_true",
        help="Replace goldens by what was obtained where they differ; such tests still fail.",
    )


@pytest.fixture
def wrinkle_golden(request: pytest.FixtureRequest) -> "WrinkleGolden":
    """Compare a glTF file with a golden: `wrinkle_golden(obtained, "goldens/knee.glb", tolerance="0.01%")`."""
    return WrinkleGolden(request.path.parent, update=bool(request.config.getoption("--wrinkle-update")))


class WrinkleGolden:
    """Compares files with goldens.

    Args:
        folder: The folder of the test file; paths of goldens are relative to it.
        update: Replace goldens that differ.
    """

    def __init__(self, folder: Path, *, update: bool = False) -> None:
        self._folder = folder
        self._update = update

    def __call__(
        self,
        obtained: str | os.PathLike[str],
        golden: str | os.PathLike[str],
        *,
        tolerance: float | str | None = None,
        **named: Any,
    ) -> None:
        """Fail the test if a file differs from its golden.

        Args:
            obtained: The .glb or .gltf to test.
            golden: The .glb to compare with, relative to the test file's folder.
            tolerance: Scene units, or such as `"0.01%"` of the asset's size; the default of `wrinkle diff` if None.
            named: Other options by their names in `wrinklecli.DiffOptions`, such as `posed` and `clips`.

        Raises:
            ValueError: The golden is no .glb, or the tolerance is no length.
            TypeError: `DiffOptions` lacks a name of `named`.
        """
        from wrinklecli.choices import DIFF_LINES
        from wrinklecli.errors import WrinkleError
        from wrinklecli.gltf.document import read_document
        from wrinklecli.review.diff.diff import DiffOptions, diff

        kept = self._folder / golden
        if kept.suffix.lower() != ".glb":
            raise ValueError(f"a golden is one file, a .glb, not {os.fspath(golden)!r}")
        if tolerance is not None:
            named["tolerance"] = _length(tolerance)
        options = DiffOptions(**named)
        beside = kept.with_name(f"{kept.stem}.obtained{kept.suffix}")
        try:
            document = read_document(obtained, allow_external=options.allow_external)
            if kept.exists():
                comparison = diff(kept, obtained, options)
                if comparison.same:
                    beside.unlink(missing_ok=True)
                    return
                lines = [f"{os.fspath(obtained)} (B) differs from {kept} (A):", *comparison.lines(DIFF_LINES)]
            else:
                lines = [f"there is no golden {kept}"]
            kept.parent.mkdir(parents=True, exist_ok=True)
            _keep(document, kept if self._update else beside)
        except WrinkleError as error:
            pytest.fail(str(error), pytrace=False)
        if self._update:
            beside.unlink(missing_ok=True)
            lines.append("the golden has been replaced; look at it, and run the test again without --wrinkle-update")
        else:
            lines.append(f"what was obtained is {beside}; pytest --wrinkle-update makes it the golden")
        pytest.fail("\n".join(lines), pytrace=False)


def _keep(document: "Document", path: Path) -> None:
    """Write a document as one file: with the same bytes if it is one, else with all its parts embedded."""
    from wrinklecli.files.outputs import Outputs
    from wrinklecli.gltf.document import GLB_MAGIC
    from wrinklecli.gltf.edited_document import EditedDocument
    from wrinklecli.gltf.files import read_file
    from wrinklecli.gltf.writer import write

    data = read_file(document.path)
    apart = len(document.files) > 1 or any("uri" in image for image in document.items("images"))
    with Outputs() as outputs:
        if apart or bytes(data[:4]) != GLB_MAGIC:
            write(EditedDocument(document), path, outputs=outputs)
        else:
            outputs.add_bytes(path, data)


def _length(tolerance: float | str) -> "Length":
    from wrinklecli.tools.records import parse_length

    try:
        return parse_length(tolerance)
    except ValueError as error:
        message = f"the tolerance {tolerance!r} is neither a length above 0 nor a percentage such as '0.01%'"
        raise ValueError(message) from error
