"""Frozen dataclasses behave as those of `dataclasses`."""

import copy
import dataclasses
import pickle
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from wrinklecli import frozen


def kinds(dataclass: Any) -> tuple[Any, Any]:
    """A record with each kind of field, and one that inherits and adds a named value."""

    @dataclass(frozen=True, slots=True)
    class Point:
        x: float
        y: float = 2.0
        beside: Mapping[str, int] = dataclasses.field(default_factory=dict, hash=False)
        hidden: str = dataclasses.field(default="", compare=False, repr=False)
        total: float = dataclasses.field(init=False)

        def __post_init__(self) -> None:
            object.__setattr__(self, "total", self.x + self.y)

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Named(Point):
        name: str

    return Point, Named


OURS, THEIRS = kinds(frozen.dataclass), kinds(dataclasses.dataclass)
# Pickle looks a class up by its name.
Point, Named = OURS
Point.__qualname__, Named.__qualname__ = "Point", "Named"

MADE: dict[str, Callable[[Any, Any], Any]] = {
    "by position": lambda point, _: point(1.0, 3.0, {"a": 1}, "hidden"),
    "by name": lambda point, _: point(hidden="hidden", x=1.0),
    "both": lambda point, _: point(1.0, beside={"a": 1}),
    "inherited": lambda _, named: named(1.0, name="here"),
    "replaced": lambda point, _: dataclasses.replace(point(1.0), y=5.0),
}


@pytest.mark.parametrize("make", MADE.values(), ids=MADE)
def test_values_are_the_same(make: Callable[[Any, Any], Any]) -> None:
    ours, theirs = make(*OURS), make(*THEIRS)
    assert dataclasses.asdict(ours) == dataclasses.asdict(theirs)
    assert repr(ours).split("(")[1:] == repr(theirs).split("(")[1:]
    assert type(ours).__match_args__ == type(theirs).__match_args__
    for again in (copy.copy(ours), copy.deepcopy(ours), pickle.loads(pickle.dumps(ours))):
        assert type(again) is type(ours)
        assert dataclasses.asdict(again) == dataclasses.asdict(ours)


def test_records_compare_by_the_fields_that_count() -> None:
    for point, named in (OURS, THEIRS):
        one = point(1.0, hidden="a")
        assert one == point(1.0, hidden="b")
        assert hash(one) == hash(point(1.0, beside={"a": 1}))
        assert len({hash(point(x)) for x in (1.0, 2.0, 3.0)}) > 1
        assert one not in (point(1.0, beside={"a": 1}), point(2.0), named(1.0, name="a"), 1.0)
        assert named(1.0, name="a") == named(1.0, name="a") != named(1.0, name="b")


def test_records_without_comparison_are_told_apart() -> None:
    alone = frozen.dataclass(frozen=True, slots=True, eq=False)(type("Alone", (), {"__annotations__": {"x": float}}))
    one: Any = alone(1.0)
    assert one != alone(1.0)
    assert len({one, one, alone(1.0)}) == 2


WRONG: dict[str, Callable[[Any, Any], Any]] = {
    "missing": lambda point, _: point(),
    "missing name": lambda _, named: named(1.0),
    "unknown": lambda point, _: point(1.0, z=1.0),
    "twice": lambda point, _: point(1.0, x=1.0),
    "too many": lambda point, _: point(1.0, 2.0, {}, "", 3.0),
    "of no argument": lambda point, _: point(1.0, total=3.0),
    "named alone": lambda _, named: named(1.0, 2.0, {}, "", "here"),
}


@pytest.mark.parametrize("make", WRONG.values(), ids=WRONG)
def test_wrong_values_are_refused(make: Callable[[Any, Any], Any]) -> None:
    for kind in (OURS, THEIRS):
        with pytest.raises(TypeError):
            make(*kind)


@pytest.mark.parametrize("change", [lambda each: setattr(each, "x", 2.0), lambda each: delattr(each, "x")])
def test_nothing_changes_a_record(change: Callable[[Any], None]) -> None:
    for point, _ in (OURS, THEIRS):
        with pytest.raises(dataclasses.FrozenInstanceError):
            change(each := point(1.0))
        assert each.x == 1.0
        with pytest.raises((AttributeError, TypeError)):
            each.other = 1


class _Stateful:
    x: float

    def __getstate__(self) -> dict[str, Any]:
        return {"x": self.x + 1.0}


def test_a_class_keeps_a_state_of_its_own() -> None:
    """Without slots, and with one half of its state alone, as the standard dataclass leaves it."""
    for module in (frozen, dataclasses):
        made: Any = module.dataclass(frozen=True)(type("Made", (_Stateful,), dict(vars(_Stateful))))
        assert copy.copy(made(1.0)).x == 2.0
