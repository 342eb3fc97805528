"""`wrinkle completion`: scripts for shells, printed or put where the shell finds them."""

import subprocess
from pathlib import Path

import pytest

from kit.command import Wrinkle


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty home folder."""
    for name in ("XDG_DATA_HOME", "XDG_CONFIG_HOME", "ZDOTDIR", "BASH_COMPLETION_USER_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    return tmp_path / "home"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_shell_of_the_user_gets_its_script(
    wrinkle: Wrinkle, home: Path, monkeypatch: pytest.MonkeyPatch, shell: str
) -> None:
    monkeypatch.setenv("SHELL", f"/usr/bin/{shell}")
    ran = wrinkle("completion")
    assert (ran.code, ran.lines) == (0, [])
    assert f"_WRINKLE_COMPLETE={shell}_complete" in ran.out
    assert list(home.iterdir()) == []
    assert wrinkle("completion", shell).out == ran.out


@pytest.mark.parametrize(
    ("shell", "place"),
    [
        ("bash", ".local/share/bash-completion/completions/wrinkle"),
        ("zsh", ".local/share/wrinkle/completion.zsh"),
        ("fish", ".config/fish/completions/wrinkle.fish"),
    ],
)
def test_it_is_installed_once_for_each_shell(wrinkle: Wrinkle, home: Path, shell: str, place: str) -> None:
    printed = wrinkle("completion", shell).out
    for _ in range(2):
        ran = wrinkle("completion", shell, "--install")
        assert ran.code == 0, ran.lines
        assert ran.lines[0] == f"written: {home / place}"
    assert (home / place).read_text() == printed.removesuffix("\n")
    assert (home / ".zshrc").exists() == (shell == "zsh")


def test_zsh_reads_it_by_one_line_below_those_of_the_user(wrinkle: Wrinkle, home: Path) -> None:
    (home / ".zshrc").write_text("alias ll='ls -l'")
    wrinkle("completion", "zsh", "--install")
    wrinkle("completion", "zsh", "--install")
    own, ours, *more = (home / ".zshrc").read_text().splitlines()
    assert (own, more) == ("alias ll='ls -l'", [])
    assert ours.endswith(f"source {home}/.local/share/wrinkle/completion.zsh")


def test_a_start_file_that_cannot_be_read_stays(wrinkle: Wrinkle, home: Path) -> None:
    (home / ".zshrc").mkdir()
    ran = wrinkle("completion", "zsh", "--install")
    assert ran.code == 1
    assert ran.lines == [f"{home}/.zshrc: cannot be read: Is a directory"]
    assert not (home / ".local").exists()


def test_an_unknown_shell_is_wrong_usage(wrinkle: Wrinkle, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SHELL", "/bin/tcsh")
    assert wrinkle("completion").code == 2
    assert wrinkle("completion", "tcsh").code == 2
    assert list(home.iterdir()) == []


def test_bash_takes_the_script(wrinkle: Wrinkle, tmp_path: Path) -> None:
    script = tmp_path / "script"
    script.write_text(wrinkle("completion", "bash").out)
    subprocess.run(["bash", "-n", script], check=True)
