"""Pair the nodes of two documents, and compare paired nodes."""

from collections.abc import Hashable, Iterator, Sequence
from typing import Any

import numpy as np

from wrinklecli.character.rig import TRANSFORM_DEFAULTS, from_roots, local_rows, parents_of, stored_weights
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.review.diff.difference import Difference, Findings, Link, Sides, brief, differ, pairs_by_key
from wrinklecli.review.diff.values import dict_differences, property_gaps, value_differences

# An empty name is none.
_UNNAMED = {None, ""}


def pair_nodes(a: Document, b: Document) -> tuple[dict[int, int], list[Difference]]:
    """Pair nodes from the roots down by name, or by index without one; then similar ones; then equal names anywhere.

    Returns:
        Nodes of the second document by those of the first; and differences: renamed, moved and unpaired nodes.
    """
    pairing = _Pairing(a, b)
    pairing.pair_below(*([i for i, parent in enumerate(each) if parent < 0] for each in pairing.parents))
    pairing.pair_elsewhere()
    pairing.report_rest()
    return pairing.nodes, pairing.found


class _Pairing:
    """Pairs nodes, step by step.

    Attributes:
        names: For each document the name of each node, or None.
        parents: For each document the parent of each node; -1 for roots.
        nodes: Paired nodes of the second document by those of the first.
        taken: Paired nodes of the second document.
        found: Differences.
    """

    def __init__(self, a: Document, b: Document) -> None:
        self.documents = a, b
        self.names = [[node.get("name") for node in document.items("nodes")] for document in (a, b)]
        self.parents = [parents_of(document.items("nodes")) for document in (a, b)]
        self.nodes: dict[int, int] = {}
        self.taken: set[int] = set()
        self.found: list[Difference] = []

    def pair_below(self, roots_a: Sequence[int], roots_b: Sequence[int]) -> None:
        """Pair two lists of nodes, and the nodes below the pairs."""
        a, b = self.documents
        nodes_a, nodes_b = a.items("nodes"), b.items("nodes")
        names_a, names_b = self.names
        known_a, known_b = (set(names) - _UNNAMED for names in self.names)
        stack = [(list(roots_a), list(roots_b))]
        while stack:
            level_a, level_b = stack.pop()
            level_a = [i for i in dict.fromkeys(level_a) if i not in self.nodes]
            level_b = [j for j in dict.fromkeys(level_b) if j not in self.taken]
            # A bake gives names to joints without one, and keeps the indices.
            pairs = {
                i: i
                for i in sorted(set(level_a) & set(level_b))
                if _UNNAMED & {names_a[i], names_b[i]}
                and names_a[i] not in known_b
                and names_b[i] not in known_a
                and _features(nodes_a[i]) == _features(nodes_b[i])
            }
            for i in pairs:
                if names_a[i] != names_b[i]:
                    self._report_name(i, i)
            named = pairs_by_key({i: names_a[i] for i in level_a}, {j: names_b[j] for j in level_b}, pairs)
            pairs = pairs_by_key(
                {i: _features(nodes_a[i]) for i in level_a if names_a[i] not in known_b},
                {j: _features(nodes_b[j]) for j in level_b if names_b[j] not in known_a},
                named,
            )
            for i, j in pairs.items():
                if i not in named:
                    self._report_name(i, j)
            self.nodes |= pairs
            self.taken |= set(pairs.values())
            stack += [(_children(a, i), _children(b, j)) for i, j in pairs.items()]

    def _report_name(self, i: int, j: int) -> None:
        names_a, names_b = self.names
        message = f"{brief(names_a[i])} -> {brief(names_b[j])}"
        self.found.append(differ("structure", ("nodes", i, "name"), message, name=names_a[i]))

    def pair_elsewhere(self) -> None:
        """Pair nodes of the same name with other parents, and the nodes below them."""
        names_a, names_b = self.names
        parents_a, parents_b = self.parents
        waiting: dict[Any, list[int]] = {}
        for j in reversed(from_roots(parents_b)):
            if j not in self.taken and names_b[j] not in _UNNAMED:
                waiting.setdefault(names_b[j], []).append(j)
        for i in from_roots(parents_a):
            while i not in self.nodes and waiting.get(names_a[i]):
                j = waiting[names_a[i]].pop()
                if j not in self.taken:
                    parents = f"{_name_at(names_a, parents_a[i])} -> {_name_at(names_b, parents_b[j])}"
                    self.found.append(differ("structure", ("nodes", i), f"parent {parents}", name=names_a[i]))
                    self.pair_below([i], [j])

    def report_rest(self) -> None:
        """Report the nodes that only one document has."""
        known_in_each = set(self.nodes), self.taken
        for known, names, parents, side in zip(known_in_each, self.names, self.parents, "AB", strict=True):
            for index, parent in enumerate(parents):
                # The nodes below a reported one are not reported.
                if index not in known and (parent < 0 or parent in known):
                    self.found.append(differ("structure", ("nodes", index), f"only in {side}", name=names[index]))


def _children(document: Document, node: int) -> list[int]:
    children: list[int] = document.items("nodes")[node].get("children", [])
    return children


def _features(node: Json) -> tuple[Hashable, ...]:
    """Features by which a renamed node is found."""
    return (*(key in node for key in ("mesh", "skin", "camera")), len(node.get("children", [])))


def _name_at(names: Sequence[Any], index: int) -> str:
    return repr(names[index]) if index >= 0 else "none"


def node_differences(sides: Sides, i: int, j: int) -> Findings:
    """Compare two paired nodes; their meshes, cameras and skins become links."""
    first, second = sides.items("nodes", i, j)
    place, name = ("nodes", i), first.get("name")
    yield from _transform_differences(sides, i, j)
    skip = {"name", "children", "skin", "weights", "matrix", *TRANSFORM_DEFAULTS}
    yield from dict_differences(first, second, place, "nodes", sides.limits, name=name, skip=skip)
    if "mesh" in first and "mesh" in second:
        weights = stored_weights(sides.a, i).tolist(), stored_weights(sides.b, j).tolist()
        # If the numbers of targets differ, the comparison of the meshes says so.
        if len(weights[0]) == len(weights[1]):
            yield from value_differences(*weights, (*place, "weights"), "nodes", sides.limits, name=name)
    if ("skin" in first) != ("skin" in second):
        yield differ("structure", (*place, "skin"), f"only in {'A' if 'skin' in first else 'B'}", name=name)
    elif "skin" in first:
        yield Link("skins", first["skin"], second["skin"], (*place, "skin"))


def _transform_differences(sides: Sides, i: int, j: int) -> Iterator[Difference]:
    first, second = sides.items("nodes", i, j)
    name = first.get("name")
    if "matrix" in first or "matrix" in second:
        one, other = (local_rows(node) for node in (first, second))
        moved = property_gaps("translation", one[None, :, 3], other[None, :, 3], sides.limits)
        turned = property_gaps("scale", one[:, :3].reshape(1, 9), other[:, :3].reshape(1, 9), sides.limits)
        if moved.any() or turned.any():
            message = f"moves by {moved[0]:.3g}, turns or scales by {turned[0]:.3g}"
            yield differ("value", ("nodes", i, "matrix"), message, name=name)
        return
    for path, default in TRANSFORM_DEFAULTS.items():
        one, other = (np.array([node.get(path, default)], np.float64) for node in (first, second))
        if property_gaps(path, one, other, sides.limits).any():
            message = " -> ".join(brief(node.get(path, list(default))) for node in (first, second))
            yield differ("value", ("nodes", i, path), message, name=name)
