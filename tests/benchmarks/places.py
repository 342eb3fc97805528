"""Fits the score of suggested tools to verdicts by eye: keep, weak or delete, in places.csv.

    python tests/benchmarks/places.py            says how often it is right on characters that it was not fitted to
    python tests/benchmarks/places.py --write    also writes the weights that the program reads
    python tests/benchmarks/places.py DIR…       first looks anew what the wanted places get
    python tests/benchmarks/places.py DIR… --measure FILE
                                                 first measures the fields anew, on all cores, into FILE, from which it
                                                 goes on if it was stopped, and from there into the tables

A row of places.csv is a place or a field that was looked at, without and with wrinkles and blind to the score: twice by
one judge, and some fields once more by each of two others. Merits are as `suggest --all --json` prints them; those of
tools are measured without fields. `suggest` proposes nothing where no `limb` folds, nor a field that would be level, so
such places are in the counts alone; and no tool where a field lies, so that places that are not `bare` are in the fit
alone. Fields and lines of a face are weighed as folds of limbs are, but for a bias of their own and a weight of
`grown`: a fit to all alike drops fields between plates of armour, and toes, which artists keep.
A row of two fields, left and right, has the merits of the one that scores less: both are proposed, or none.
The model is an ordinal logistic regression: one weighted sum of their logarithms, and a bias for each of "at least
weak" and "keep"; looks of a place count alike, and places too. Weights in units of the logarithms' deviations have a
normal prior of unit width. The program needs the sum and the bias of "keep". A merit that is not known counts as the
mean of those to keep. What is proposed has at least a chance to be kept that follows from this: each character left out
in turn, four of five proposals, of tools and of tools and fields together, are kept by the mean of the looks.

A row of unseen.csv is a place that the fit does not have: nobody had seen its character before what is proposed there.
When a fit learns from such rows, they move to places.csv, and others are looked for. Fields on a penguin, of which
nothing says that it wears no clothes, stay: nobody keeps them, and the fit does not see why.
sources.csv has the public repositories of characters; folders have their files, named for the character.

A row of wanted.csv is a place that an artist wants on a character, left and right alike, and the tool or the field that
`suggest` proposes there.
"""

import argparse
import csv
import json
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

HERE = Path(__file__).resolve().parent
if __name__ == "__main__":  # imported by a test, it changes no path that other tests see
    sys.path[:0] = [str(HERE.parents[1])]

from wrinklecli.character.bent import bending_nodes  # noqa: E402
from wrinklecli.character.bones import read_bones  # noqa: E402
from wrinklecli.character.rig import read_rig  # noqa: E402
from wrinklecli.gltf.document import read_document  # noqa: E402
from wrinklecli.numeric.processes import core_count, in_processes  # noqa: E402
from wrinklecli.review.suggest.garments import LEAST_BENT  # noqa: E402
from wrinklecli.review.suggest.place_names import NOUNS  # noqa: E402
from wrinklecli.review.suggest.score import LEAST, Merits, Score  # noqa: E402
from wrinklecli.review.suggest.suggest import suggest  # noqa: E402

PLACES = HERE / "places.csv"
UNSEEN = HERE / "unseen.csv"
WANTED = HERE / "wanted.csv"
WEIGHTS = HERE.parents[1] / "wrinklecli" / "review" / "suggest" / "score.json"
VERDICTS = ("delete", "weak", "keep")
# The third and the fourth are those of two more judges. Where there are none, the first two count twice.
LOOKS = ("first", "second", "third", "fourth")
# Places on sheets that were built to show one fault each: the fit learns from them, and nobody counts them.
BUILT = "sheet"
# What the name of a field begins with.
FIELD = "field "
# What the names of lines of a face have.
LINES = re.compile("brow|forehead|glabella|cheek|Fcl_")
# Digits of a weight: merits have three.
DIGITS = 3
# Merits that have a weight of their own for fields and lines of a face.
OWN = ("grown",)
# Part of what is proposed that should be kept.
ASKED = 0.8

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Places:
    """The table: names of merits, and arrays with a row for each place.

    Attributes:
        names: Of the merits.
        characters: (places,)
        limbs: (places,) True where a limb folds.
        counted: (places,) True where no field lies, on no sheet that was built.
        fields: (places,) True for fields.
        folds: (places,) True for folds of a limb: neither fields nor lines of a face.
        verdicts: (places, looks)
        logs: (places, merits) their logarithms.
    """

    names: list[str]
    characters: NDArray[np.str_]
    limbs: NDArray[np.bool_]
    counted: NDArray[np.bool_]
    fields: NDArray[np.bool_]
    folds: NDArray[np.bool_]
    verdicts: NDArray[np.intp]
    logs: Floats

    def only(self, chosen: NDArray[np.bool_]) -> "Places":
        """Some of the places."""
        rows = (self.characters, self.limbs, self.counted, self.fields, self.folds, self.verdicts, self.logs)
        return Places(self.names, *(each[chosen] for each in rows))


@dataclass(frozen=True)
class Fit:
    """The (merits,) weights of a fit, (2,) biases of "at least weak" and of "keep", and what is not of folds alone.

    Fields and lines of a face have (2,) biases of their own, and weights of the merits `OWN` beside those of folds.
    """

    weights: Floats
    biases: Floats
    other_biases: Floats
    other_weights: Floats

    @classmethod
    def of(cls, places: Places) -> "Fit":
        """Fit weights to folds of limbs, and to fields and lines of a face what these have of their own."""
        folds, others = (places.only(places.limbs & own) for own in (places.folds, ~places.folds))
        weights, biases = _fitted(folds.logs, folds.verdicts)
        other_weights, other_biases = _fitted(_own(others), others.verdicts, others.logs @ weights)
        return cls(weights, biases, other_biases, other_weights)

    def chances(self, places: Places) -> Floats:
        """(places, 2) probabilities of "at least weak" and of "keep"."""
        of_others = self.other_biases + (_own(places) @ self.other_weights)[:, None]
        sums = (places.logs @ self.weights)[:, None] + np.where(places.folds[:, None], self.biases, of_others)
        found: Floats = places.limbs[:, None] / (1.0 + np.exp(-sums))
        return found


def _own(places: Places) -> Floats:
    """(places, merits) logarithms of the merits `OWN`."""
    return places.logs[:, [places.names.index(name) for name in OWN]]


def _fitted(logs: Floats, verdicts: NDArray[np.intp], known: Floats | float = 0.0) -> tuple[Floats, Floats]:
    """Weights of (places, merits) logarithms, and two biases, beside a (places,) sum that is known."""
    # A merit that is known of none of the places has one value, and gets no weight.
    means, deviations = logs.mean(axis=0), np.where(np.ptp(logs, axis=0) > 0, logs.std(axis=0), 1.0)
    scaled, count = (logs - means) / deviations, logs.shape[1]

    def loss(values: Floats) -> tuple[float, Floats]:
        weights, found, slopes = values[:count], 0.5 * values[:count] @ values[:count], values.copy()
        slopes[count:] = 0.0
        for step in range(2):
            # The mean over the looks of a place, which may differ.
            sums, above = known + scaled @ weights + values[count + step], np.mean(verdicts > step, axis=1)
            off = 1.0 / (1.0 + np.exp(-sums)) - above
            found += np.sum(np.logaddexp(0.0, sums) - above * sums)
            slopes[:count] += off @ scaled
            slopes[count + step] += off.sum()
        return float(found), slopes

    values = minimize(loss, np.zeros(count + 2), jac=True, method="L-BFGS-B").x
    weights = values[:count] / deviations
    return weights, values[count:] - weights @ means


def read_places(path: Path = PLACES, usual: Floats | None = None) -> Places:
    """Read a table; merits that are not known have the (merits,) `usual` logarithms, by default those of its keeps."""
    rows = read_rows(path)
    names = list(rows[0])[2 + len(LOOKS) : -2]
    merits = np.array([[float(row[name] or "nan") for name in names] for row in rows])
    logs = np.log2(np.clip(merits, LEAST, 1.0))
    looks = [[row[look] or row[LOOKS[number % 2]] for number, look in enumerate(LOOKS)] for row in rows]
    verdicts = np.array([[VERDICTS.index(each) for each in row] for row in looks])
    if usual is None:
        usual = np.nanmean(logs[(verdicts == VERDICTS.index("keep")).any(axis=1)], axis=0)
    return Places(
        names,
        np.array([row["character"] for row in rows]),
        np.array([row["limb"] == "1" for row in rows]),
        np.array([row["bare"] == "1" and row["character"] != BUILT for row in rows]),
        np.array([row["tool"].startswith(FIELD) for row in rows]),
        np.array([not (row["tool"].startswith(FIELD) or LINES.search(row["tool"])) for row in rows]),
        verdicts,
        np.where(np.isnan(logs), usual, logs),
    )


def left_out(places: Places) -> Floats:
    """(places, 2) chances of each place by a fit to all characters but its own."""
    found = np.zeros((len(places.verdicts), 2))
    for character in np.unique(places.characters):
        own = places.characters == character
        found[own] = Fit.of(places.only(~own)).chances(places.only(own))
    return found


def right(places: Places, chances: Floats) -> float:
    """The part of looks whose verdict is the likeliest one."""
    steps = np.concatenate([np.ones((len(chances), 1)), chances, np.zeros((len(chances), 1))], axis=1)
    return float(np.mean((steps[:, :-1] - steps[:, 1:]).argmax(axis=1)[:, None] == places.verdicts))


def commonest(places: Places) -> float:
    """The part of looks that have the commonest verdict."""
    return float(np.bincount(places.verdicts.ravel()).max() / places.verdicts.size)


def agreed(places: Places) -> NDArray[np.bool_]:
    """(places,) True where the looks agree."""
    found: NDArray[np.bool_] = np.ptp(places.verdicts, axis=1) == 0
    return found


def least_of(places: Places, chances: Floats) -> float:
    """The least chance, in thousandths, from which looks keep `ASKED` of tools, and of tools and fields together."""
    tools = places.counted & ~places.fields
    for least in np.arange(1, 10**DIGITS) / 10**DIGITS:
        likely = chances[:, 1] >= least
        kept = [places.verdicts[likely & chosen] == 2 for chosen in (tools, tools | places.fields)]
        if all(len(each) and each.mean() >= ASKED for each in kept):
            return float(least)
    return 1.0


def proposed(places: Places, chances: Floats, least: float) -> tuple[list[float], float]:
    """The numbers of places that are proposed, to keep, weak and to delete; and the part of those to keep that are."""
    chosen, whole = places.verdicts[chances[:, 1] >= least], places.verdicts
    counts = [float(np.sum(chosen == verdict)) / len(LOOKS) for verdict in (2, 1, 0)]
    return counts, float(np.sum(chosen == 2) / max(np.sum(whole == 2), 1))


def report(places: Places, chances: Floats, least: float) -> str:
    """A text that says how often chances are right."""
    apart = np.ptp(places.verdicts, axis=1)
    lines = [
        f"{len(chances)} places on {len(np.unique(places.characters))} characters:",
        f"the looks agree on {100 * np.mean(apart == 0):.1f} %, and are opposite on {np.sum(apart == 2)} places",
        f"right {100 * right(places, chances):.1f} %; the commonest verdict {100 * commonest(places):.1f} %",
    ]
    for name, chosen in (("all", apart >= 0), ("where the looks agree", agreed(places))):
        (keep, weak, delete), found = proposed(places.only(chosen), chances[chosen], least)
        count = keep + weak + delete
        lines += [
            f"{name}: proposed {count:g}: {keep:g} keep ({100 * keep / max(count, 1):.0f} %), {weak:g} weak,"
            f" {delete:g} delete; {100 * found:.0f} % of those to keep"
        ]
    return "\n".join(lines)


def usual_of(places: Places) -> Floats:
    """(merits,) mean logarithms of the tools that are to keep where a limb folds."""
    kept = (places.verdicts == VERDICTS.index("keep")).any(axis=1)
    found: Floats = places.only(kept & places.limbs & places.folds).logs.mean(axis=0)
    return found


def weights_of(places: Places) -> dict[str, object]:
    """The weights as the program reads them."""
    fit = Fit.of(places)

    def by_name(values: Floats, names: Sequence[str] = places.names) -> dict[str, float]:
        return dict(zip(names, (np.round(values, DIGITS) + 0.0).tolist(), strict=True))

    return {
        "least": least_of(places, left_out(places)),
        "bias": round(float(fit.biases[1]), DIGITS),
        # Folds have no weight of what is known of fields alone.
        "weights": {name: weight for name, weight in by_name(fit.weights).items() if weight},
        "others": {"bias": round(float(fit.other_biases[1]), DIGITS), **by_name(fit.other_weights, OWN)},
        "kept": by_name(usual_of(places)),
    }


def read_rows(path: Path) -> list[dict[str, str]]:
    """Read the rows of a table."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def write_rows(path: Path, rows: Sequence[Mapping[str, str]]) -> None:
    """Write the rows of a table."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def measure_character(files: Mapping[str, Path], done: Path, character: str) -> None:
    """Add merits of the fields of a character, also of those that `suggest` leaves out, to the lines of a file."""
    found = suggest(files[character], everything=True, count=0, progress=lambda *_: None).fields
    merits = {each.field.name: asdict(each.judgement.merits) for each in found if each.judgement}
    with done.open("a", encoding="utf-8") as file:
        file.write(json.dumps([character, merits]) + "\n")


def measure_fields(files: Mapping[str, Path], done: Path) -> None:
    """Put merits of fields into the tables, of characters that have a file.

    Args:
        files: By the names of characters.
        done: A line of JSON for each character that is measured already; others are added.
    """
    tables = {path: read_rows(path) for path in (PLACES, UNSEEN)}
    rows = [row for table in tables.values() for row in table if row["tool"].startswith(FIELD)]

    def known() -> dict[str, dict[str, dict[str, float]]]:
        return dict(map(json.loads, done.read_text(encoding="utf-8").splitlines()))

    done.touch()
    asked = [each for each in files.keys() & {row["character"] for row in rows} if each not in known()]
    list(in_processes(partial(measure_character, files, done), sorted(asked), core_count()))
    measured = known()
    for row in (row for row in rows if row["character"] in measured):
        own = measured[row["character"]]
        pair = [Merits(**own[name]) for name in row["tool"].removeprefix(FIELD).split(" + ") if name in own]
        # A field that is level keeps the merits that it had.
        row["limb"] = "1" if pair else "0"
        for name, value in asdict(min(pair, key=lambda each: Score.of(each).keep)).items() if pair else ():
            row[name] = "" if np.isnan(value) else f"{round(value, DIGITS):g}"
    for path, table in tables.items():
        write_rows(path, table)


def look_anew(wanted: list[dict[str, str]], files: Mapping[str, Path]) -> None:
    """Suggest for each character that has a file, and write what its wanted places get."""
    for character in dict.fromkeys(row["character"] for row in wanted if row["character"] in files):
        found = suggest(files[character])
        document = read_document(files[character])
        names, parts = [str(each.get("name")) for each in document.items("nodes")], read_bones(document).parts
        folds: dict[str, list[str]] = {}  # names of what folds places, by the noun of the place
        for each in found.tools:
            folds.setdefault(each.place.noun if each.place else each.driver, []).append(each.tool.name)
        for garment in found.fields:
            bent = bending_nodes(document, read_rig(document, names.index(garment.mesh)), LEAST_BENT)
            for joint in bent:
                part = parts[joint]
                if part and (garment.field.joints == "all" or names[joint] in garment.field.joints):
                    folds.setdefault(NOUNS[part], []).append(garment.field.name)
        for row in (row for row in wanted if row["character"] == character):
            row["got"] = " ".join(dict.fromkeys(folds.get(row["place"].replace("_", " "), [])))
    write_rows(WANTED, wanted)


def recall(wanted: list[dict[str, str]]) -> str:
    """A text that says how many wanted places get something, and which get nothing."""
    missing = [row for row in wanted if not row["got"]]
    lines = [f"{len(wanted) - len(missing)} of {len(wanted)} wanted places get a tool or lie in a field; not:"]
    return "\n".join([*lines, *(f"  {row['character']}: {row['place']}" for row in missing)])


def main() -> None:
    """Command line: see the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write the weights that the program reads")
    parser.add_argument("--measure", type=Path, metavar="FILE", help="measure fields anew; FILE has what is measured")
    parser.add_argument("folders", nargs="*", type=Path, help="folders with the characters' files")
    options = parser.parse_args()
    files = {path.stem: path for folder in options.folders for path in sorted(folder.glob("*.glb"))}
    if options.measure:
        measure_fields(files, options.measure)
    places = read_places()
    chances = left_out(places)
    least, tools = least_of(places, chances), places.counted & ~places.fields
    print(f"proposed is what artists keep with a probability of {100 * least:.0f} % or more")
    print("each character left out in turn:")
    for name, chosen in (("tools", tools), ("fields", places.fields), ("together", tools | places.fields)):
        print(f"{name}: {report(places.only(chosen), chances[chosen], least)}")
    unseen = read_places(UNSEEN, usual_of(places))
    print(f"unseen: {report(unseen, Fit.of(places).chances(unseen), least)}")
    wanted = read_rows(WANTED)
    if files and not options.measure:
        look_anew(wanted, files)
    print(recall(wanted))
    if options.write:
        WEIGHTS.write_text(json.dumps(weights_of(places), indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
