"""Every command that writes, ended at every line from where it begins to: all of its files are new, or none is."""

import signal
from pathlib import Path

import pytest

import wrinklecli
from kit.killed import contents, ended_at_lines
from kit.limb import limb_asset, tool, write_tools

# By the name of a command: its arguments, and its main output.
COMMANDS = {
    "bake": ("bake limb.glb tools.yaml -o out.gltf --report r.json --depfile out.d", "out.gltf"),
    "frames": ("bake limb.glb tools.yaml -o out.glb --mode frames --fps 1 --frames-dir a/b", "out.glb"),
    "track": ("track baked.glb limb.glb bent.gltf -o tracked", "tracked/bent.gltf"),
    "suggest": ("suggest limb.glb --all --force -o new.yaml", "new.yaml"),
    "check": ("check limb.glb tools.yaml --plot new.svg", "new.svg"),
    "preview": ("preview limb.glb -o new.png --rest --size 32x32", "new.png"),
    "schema": ("schema -o new.json", "new.json"),
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Assets and tools, and earlier outputs to be replaced."""
    made = tmp_path / "folder"
    made.mkdir()
    limb_asset(rings=15, sides=6).write(made / "limb.glb")
    limb_asset(rings=15, sides=6).write(made / "bent.gltf")
    tools = write_tools(made / "tools.yaml", tool(bumps=2), refinement={"max_levels": 0}, sampling={"fps": 4})
    for name in ("baked.glb", "out.gltf"):
        wrinklecli.bake(made / "limb.glb", tools, made / name)
    write_tools(tools, tool(bumps=1), refinement={"max_levels": 0}, sampling={"fps": 4})
    for name in ("r.json", "out.glb", "new.yaml", "new.svg"):
        (made / name).write_text("old")
        (made / name).chmod(0o600)
    return made


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "sign", "step"),
    [
        # Each fifth line of a bake, and each tenth or fewer of what writes as it does, by the signal that a command
        # answers or by the one that ends it.
        ("frames", signal.SIGKILL, 29),
        ("track", signal.SIGINT, 29),
        *(("bake", sign, 5) for sign in (signal.SIGTERM, signal.SIGKILL)),
        *(("bake", sign, 10) for sign in (signal.SIGINT, signal.SIGHUP)),
        *((name, signal.SIGTERM, 10) for name in ("frames", "check", "schema")),
        *((name, signal.SIGKILL, 10) for name in ("track", "suggest", "preview")),
    ],
)
def test_a_signal_at_any_line_leaves_all_files_new_or_none(
    name: str, sign: signal.Signals, step: int, folder: Path
) -> None:
    arguments, main = COMMANDS[name]
    old = contents(folder)
    *ended, whole = ended_at_lines(folder, sign, step, *arguments.split())
    new = whole.left
    assert (whole.code, whole.reached) == (0, False)
    assert len(ended) > 100 / step
    assert new[main] != old.get(main)
    for each in ended:
        assert not any(".wrinkle-" in path for path in each.left), each.line
        if sign != signal.SIGKILL:
            assert each.left == (new if each.code == 0 else old), each.line
            assert each.code in (0, 128 + sign), each.line
            continue
        assert each.code == -signal.SIGKILL
        assert all(not content or content in (old.get(path), new.get(path)) for path, content in each.left.items())
        # The main output comes last, and what goes with the old one goes after it.
        if each.left.get(main) == new[main]:
            assert new.items() <= each.left.items(), each.line
        else:
            assert old.keys() <= each.left.keys(), each.line
    codes = {each.code for each in ended}
    assert codes == ({-signal.SIGKILL} if sign == signal.SIGKILL else {0, 128 + sign})


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("sign", [signal.SIGTERM, signal.SIGKILL])
def test_a_batch_ended_at_any_line_leaves_outputs_new_or_old_and_no_wrong_cache(
    sign: signal.Signals, folder: Path
) -> None:
    def parted(left: dict[str, str]) -> tuple[dict[str, str], dict[str, str]]:
        """Outputs and inputs, and contents that the cache has whole."""
        kept = {path: each for path, each in left.items() if path.startswith("kept/files/") and ".part-" not in path}
        return {path: each for path, each in left.items() if not path.startswith("kept")}, kept

    old = contents(folder)
    arguments = "batch limb.glb --tools tools.yaml --out out.gltf --cache kept -q"
    *ended, whole = ended_at_lines(folder, sign, 10, *arguments.split())
    new, cached = parted(whole.left)
    assert (whole.code, whole.reached) == (0, False)
    assert new["out.gltf"] != old["out.gltf"]
    assert any(len(parted(each.left)[1]) < len(cached) and each.left["out.gltf"] == new["out.gltf"] for each in ended)
    for each in ended:
        outputs, kept = parted(each.left)
        assert kept.items() <= cached.items(), each.line
        if sign == signal.SIGKILL:
            assert each.code == -signal.SIGKILL
            assert all(not left or left in (old.get(path), new.get(path)) for path, left in outputs.items()), each.line
            assert outputs["out.gltf"] == old["out.gltf"] or new.items() <= outputs.items(), each.line
        else:
            assert each.code in (0, 128 + sign)
            assert outputs in ([new] if each.code == 0 else [old, new]), each.line
