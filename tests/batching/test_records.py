"""A batch tells other programs its outcomes as one object of JSON, and as JUnit's XML."""

import json
import re
from pathlib import Path
from xml.etree.ElementTree import Element, fromstring

import pytest

import wrinklecli
from kit.command import Wrinkle
from kit.limb import limb_asset, tool, write_tools
from wrinklecli.batching.jobs import BatchJob, Outcome
from wrinklecli.batching.records import junit

# Of junit-10.xsd of Jenkins' xunit-plugin: the attributes and children of each element; those that must be there.
SCHEMA = {
    "testsuites": ("name time tests failures errors", "testsuite", ""),
    "testsuite": (
        "name tests failures errors group time skipped timestamp hostname id package file log url",
        "testsuite testcase properties system-out system-err",
        "name tests failures errors",
    ),
    "testcase": ("name time classname group", "skipped error failure system-out system-err", "name"),
    "skipped": ("type message", "", ""),
    "failure": ("type message", "", ""),
    "error": ("type message", "", ""),
    "system-err": ("", "", ""),
}


def checked(element: Element) -> Element:
    """An element that the schema allows, with all below it."""
    attributes, children, required = (words.split() for words in SCHEMA[element.tag])
    assert set(required) <= set(element.attrib) <= set(attributes)
    assert {each.tag for each in element} <= set(children)
    for key in {"tests", "failures", "errors", "skipped"} & set(element.attrib):
        assert int(element.attrib[key]) >= 0
    assert re.fullmatch(r"\d+\.\d+", element.get("time", "0.0"))
    for each in element:
        checked(each)
    return element


def test_each_job_is_a_test_case_that_ci_systems_can_read() -> None:
    jobs = [BatchJob(f"m.yaml:{n}: jobs[{n}]", "a.glb", ("t.yaml",), f"o<&\x1b\udcff{n}.glb") for n in range(5)]
    outcomes = [
        Outcome(jobs[0], "built", seconds=1.5, warnings=("a & b\x00",)),
        Outcome(jobs[1], "hit", reason="in place"),
        Outcome(jobs[2], "failed", lines=("a.glb: is no glTF", "another")),
        Outcome(jobs[3], "bug", lines=("Traceback", "KeyError: 1")),
    ]
    root = checked(fromstring(junit("m.yaml", outcomes, jobs[4:], 2.0)))
    (suite,) = root
    counts = ("tests", "failures", "errors", "skipped")
    assert [suite.get(key) for key in counts] == ["5", "1", "1", "2"]
    assert suite[0].get("name") == "o<&\\x1b\\udcff0.glb"
    found = [[(each.tag, each.get("message")) for each in case] for case in suite]
    assert found == [
        [("system-err", None)],
        [("skipped", "in place")],
        [("failure", "m.yaml:2: jobs[2]: a.glb: is no glTF")],
        [("error", "m.yaml:3: jobs[3]: KeyError: 1")],
        [("skipped", "not begun")],
    ]
    assert suite[2][0].text == "m.yaml:2: jobs[2]: a.glb: is no glTF\nm.yaml:2: jobs[2]: another"


@pytest.fixture
def manifest(wrinkle: Wrinkle, tmp_path: Path) -> Wrinkle:
    """The command, in a folder with a manifest of a sound job and of one whose asset is not there."""
    limb_asset(rings=7, sides=6).write(tmp_path / "limb.glb")
    write_tools(tmp_path / "t.yaml", tool(bumps=1), refinement={"max_levels": 0}, sampling={"fps": 4})
    jobs = "  - {asset: absent.glb, out: a.glb}\n  - {asset: limb.glb, out: b.glb}\n"
    (tmp_path / "m.yaml").write_text(f"version: 1\ndefaults: {{tools: t.yaml}}\njobs:\n{jobs}")
    return wrinkle


@pytest.mark.slow
def test_the_command_and_python_say_the_same(manifest: Wrinkle) -> None:
    ran = manifest("batch", "m.yaml", "--json", "--junit", "ci/j.xml", "--report", "r.jsonl")
    data = json.loads(ran.out)
    assert (ran.code, next(iter(data.items())), data["not_begun"]) == (1, ("batch", 1), [])
    assert data["counts"] == {"failed": 1, "built": 1}
    assert data["jobs"] == [json.loads(line) for line in Path("r.jsonl").read_text().splitlines()]
    assert [line.partition(": absent")[0] for line in ran.lines] == ["m.yaml:4: jobs[0]"]
    cases = checked(fromstring(Path("ci/j.xml").read_bytes()))[0]
    assert [[each.tag for each in case] for case in cases if case.get("name") == "a.glb"] == [["failure"]]

    made = wrinklecli.batch("m.yaml", keep_going=False, junit="j.xml")
    assert [each.result for each in made.outcomes] == ["failed"]
    assert [job.out for job in made.not_begun] == ["b.glb"]
    assert [[each.get("message") for each in case] for case in fromstring(Path("j.xml").read_bytes())[0]][1] == [
        "not begun"
    ]
    assert json.loads(json.dumps(made.data))["not_begun"] == ["b.glb"]
    assert json.loads(manifest("batch", "m.yaml", "--json", "--dry-run").out)["counts"] == {"failed": 1, "hit": 1}


@pytest.mark.parametrize("options", [("--json", "--report", "-"), ("--dry-run", "--junit", "j.xml")])
def test_options_that_exclude_each_other_are_wrong_usage(options: tuple[str, ...], manifest: Wrinkle) -> None:
    ran = manifest("batch", "m.yaml", *options)
    assert (ran.code, ran.out) == (2, "")


def test_junit_goes_over_no_input_and_into_no_output(manifest: Wrinkle) -> None:
    for path in ("limb.glb", "b.glb", "m.yaml", "t.yaml"):
        ran = manifest("batch", "m.yaml", "--junit", path)
        assert (ran.code, ran.out) == (1, "")
        assert any(path in line for line in ran.lines)
    with pytest.raises(wrinklecli.WrinkleError, match=r"m\.txt: does not end in '\.yaml'"):
        wrinklecli.batch("m.txt")
