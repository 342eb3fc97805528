"""The names by which a tools file says on which node's mesh a tool is.

Converters drop names of nodes: gltfpack puts a quantised mesh on a node without one, below the node that had it.
"""

from collections import Counter

from wrinklecli.character.rig import free_names, read_parents, upwards
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document


@dataclass(frozen=True, slots=True)
class MeshNames:
    """The names of the nodes that have a mesh.

    Attributes:
        own: One for each of these nodes: its own if no other of them has it, or else its number, as in `node_3`.
        ways: What a name may be, the first way first: a node's own name, its number, the nearest name above a node
            whose own tells nothing, the name of its mesh. Each name has the nodes that it may mean.
    """

    own: dict[int, str]
    ways: tuple[dict[str, list[int]], ...]

    @classmethod
    def of(cls, document: Document) -> "MeshNames":
        """Read the names; AssetError if the hierarchy is malformed."""
        nodes, meshes, parents = document.items("nodes"), document.items("meshes"), read_parents(document)
        numbered, below = free_names(nodes), dict[int, list[int]]()
        ways: tuple[dict[str, list[int]], ...] = ({}, {}, {}, {})
        with_mesh = [index for index, node in enumerate(nodes) if "mesh" in node]
        for index in with_mesh:
            for way, name in (
                (0, nodes[index].get("name")),
                (1, numbered(index)),
                (3, meshes[nodes[index]["mesh"]].get("name")),
            ):
                # A lone half of a character cannot be written in a tools file.
                if name and name == name.encode("utf-8", "ignore").decode():
                    ways[way].setdefault(name, []).append(index)
            for at in upwards(parents, int(parents[index])):
                below.setdefault(at, []).append(index)
        own = own_names(document)
        for index in with_mesh:
            if own[index] != nodes[index].get("name"):
                at = next((each for each in upwards(parents, int(parents[index])) if nodes[each].get("name")), -1)
                if at >= 0:
                    ways[2][nodes[at]["name"]] = sorted({*ways[2].get(nodes[at]["name"], ()), *below[at]})
        return cls(own, ways)

    def called(self, name: str) -> list[int]:
        """The nodes that a name may mean: none, one, or several."""
        return next((way[name] for way in self.ways if name in way), [])

    def name_of(self, node: int) -> str:
        """The name of a node with a mesh that says most and means it alone."""
        names = [name for way in (0, 2, 3, 1) for name, nodes in self.ways[way].items() if node in nodes]
        return next((name for name in names if self.called(name) == [node]), self.own[node])


def own_names(document: Document) -> dict[int, str]:
    """A name for each node that has a mesh: its own if no other of them has it, or else its number."""
    nodes = document.items("nodes")
    free = free_names(nodes)
    names = {index: node.get("name") for index, node in enumerate(nodes) if "mesh" in node}
    counts = Counter(names.values())
    return {index: name if name and counts[name] == 1 else free(index) for index, name in names.items()}
