"""What is said of text that is no YAML: a line and what to mend, for those who meet YAML for the first time."""

import pytest

from kit.tools_text import HEAD, lines_of

ALIKE = "what belongs together is indented alike"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            HEAD.replace("    target", "   target"),
            f"5: YAML: indented by 3 spaces, but `origin` on line 4 by 4: {ALIKE}",
        ),
        (
            HEAD.replace("    target", "      target"),
            f"5: YAML: indented by 6 spaces, but `origin` on line 4 by 4: {ALIKE}",
        ),
        (HEAD.replace("    ", "  "), f"4: YAML: indented by 2 spaces, but `name` on line 3 by 4: {ALIKE}"),
        (HEAD + "    bumps: 5\n     width: 1\n", f"7: YAML: indented by 5 spaces, but `bumps` on line 6 by 4: {ALIKE}"),
        (
            HEAD + "    clips:\n      walk: 1\n   width: 1\n",
            f"8: YAML: indented by 3 spaces, but `clips` on line 6 by 4: {ALIKE}",
        ),
        (HEAD + " - name: b\n", f"6: YAML: indented by 1 space, but `-` on line 3 by 2: {ALIKE}"),
        (HEAD + "   - name: b\n", f"6: YAML: indented by 3 spaces, but `-` on line 3 by 2: {ALIKE}"),
        ("version: 1\n tools:\n", f"2: YAML: indented by 1 space, but `version` on line 1 by 0: {ALIKE}"),
        (HEAD.replace("    origin", "\torigin"), "4: YAML: indented by a tab; only spaces are taken"),
        (HEAD.replace("- name", "-name"), "3: YAML: a space is missing behind the dash"),
        (HEAD.replace("3]\n", "3\n", 1), "4: YAML: no ] closes this [, or a comma is missing"),
        (HEAD.replace("[1, 2, 3]", "{marker: a"), "4: YAML: no } closes this {, or a comma is missing"),
        (HEAD.replace("origin: ", "origin:"), "4: YAML: expected `key: value`, with a space behind the colon"),
        (HEAD + "    bumps\n", "6: YAML: expected `key: value`, with a space behind the colon"),
        (HEAD.replace("brow.L", '"brow.L'), "3: YAML: a quote is opened here, but not closed"),
        (HEAD.replace("brow.L", "left: brow"), "3: YAML: a value that has a colon in it needs quotes"),
        (HEAD.replace("brow.L", "@brow"), "3: YAML: a value that begins with such a character needs quotes"),
        (HEAD.replace("brow.L", "*.L"), "3: YAML: a value that begins with such a character needs quotes"),
    ],
)
def test_a_mistake_is_said_in_words(text: str, expected: str) -> None:
    assert lines_of(text) == [f"t.yaml:{expected}"]
