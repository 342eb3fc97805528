"""A baked node and the others among which its mesh was split, as one body."""

import numpy as np

from wrinklecli.baking.baked_body import BakedBody, BakedPart

NODE = BakedPart("skin", None, 1, ("smile", "wrinkle_a_0"), np.array([0.5, 0.0]), True)
OTHER = BakedPart("skin_1", None, 1, ("wrinkle_b_0",), np.array([0.25]), False)
BODY = BakedBody(parts=(NODE, OTHER), drives=(), undriven=frozenset(), ambiguous=False, draft=False)


def test_a_body_is_known_by_its_first_part() -> None:
    assert (BODY.node, BODY.skinned, BODY.targets) == ("skin", True, ("smile", "wrinkle_a_0"))
    assert BODY.stored(["wrinkle_b_0", "smile"]).tolist() == [0.25, 0.5]


def test_further_targets_are_those_of_the_first_part_and_0_at_rest() -> None:
    more = BODY.with_targets(["smile", "wrinkle_c_0"])
    assert more.targets == ("smile", "wrinkle_a_0", "wrinkle_c_0")
    assert more.parts[0].stored.tolist() == [0.5, 0.0, 0.0]
    assert more.parts[1:] == BODY.parts[1:]
    assert BODY.with_targets(["smile"]) is BODY
