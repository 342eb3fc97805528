"""Searches that are kept by the arrays that they depend on."""

from dataclasses import dataclass, field

import numpy as np

from wrinklecli.effects.kept import kept_search, solutions_in
from wrinklecli.numeric.arrays import Ints


@dataclass
class Store:
    kept: dict[str, bytes] = field(default_factory=dict)
    refused: list[str] = field(default_factory=list)

    def find(self, key: str, most: int) -> bytes | None:
        data = self.kept.get(key)
        return data if data is None or len(data) <= most else None

    def keep(self, key: str, data: bytes) -> None:
        self.kept[key] = data

    def refuse(self, key: str, reason: str) -> None:
        self.refused.append(f"{key}: {reason}")


def test_searches_are_found_by_their_name_and_all_arrays() -> None:
    store, searched = Store(), list[float]()

    def found(*inputs: list[float], name: str = "sums", count: int = 1) -> list[int]:
        def search() -> Ints:
            searched.append(sum(map(sum, inputs)))
            return np.full(count, int(searched[-1]))

        return kept_search(search, name, count, map(np.array, inputs)).tolist()

    assert found([1.0, 2.0]) == found([1.0, 2.0]) == [3]
    assert len(searched) == 2  # without a store
    with solutions_in(store):
        assert found([1.0, 2.0]) == found([1.0, 2.0]) == [3]
        assert len(searched) == 3
        # Another name, another number, and the same numbers divided otherwise are other searches.
        assert found([1.0, 2.0], name="others") == found([1.0], [2.0]) == [3]
        assert found([1.0, 2.5]) == [3]
        assert len(searched) == 6 == 2 + len(store.kept)


def test_searches_that_are_cut_off_are_done_again() -> None:
    store = Store()
    with solutions_in(store):
        for _ in range(2):
            assert kept_search(lambda: np.arange(3), "count", 3, [np.zeros(2)]).tolist() == [0, 1, 2]
            ((key, data),) = store.kept.items()
            assert data == np.arange(3).astype("<u4").tobytes()
            store.kept[key] = data[:-4]
    assert len(store.refused) == 1
    assert "is not what was searched for" in store.refused[0]
