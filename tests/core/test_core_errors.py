"""The family of errors is the one its docstring draws, and an error keeps what it knows."""

from __future__ import annotations

import copy
import inspect
import pickle
import re

import pytest

from quavelet.core import errors
from quavelet.core.errors import BusBusy, BusError, BusPermission, DeviceMissing, ImuError, WrongChip

PUBLIC = {
    name: value
    for name, value in vars(errors).items()
    if inspect.isclass(value) and value.__module__ == errors.__name__
}
LINE = re.compile(r"^(?P<indent>[│ ]*)(?:[├└]── )?(?P<name>[A-Z]\w+)(?: \((?P<also>\w+)\))?", re.MULTILINE)


def drawn() -> dict[str, tuple[str, ...]]:
    """Name and bases of every class in the tree of the module's docstring."""
    tree: dict[str, tuple[str, ...]] = {}
    above: list[str] = []
    drawing = str(errors.__doc__).partition("\n\n")[2]
    for match in LINE.finditer(drawing):
        depth = len(match["indent"]) // 4 + (match[0][len(match["indent"])] in "├└")
        above[depth:] = [match["name"]]
        parent = above[depth - 1] if depth else "Exception"
        tree[match["name"]] = tuple(filter(None, (parent, match["also"])))
    return tree


def test_the_tree_in_the_docstring_is_the_tree_of_the_classes():
    assert drawn() == {name: tuple(base.__name__ for base in kind.__bases__) for name, kind in PUBLIC.items()}
    assert {"ImuError", "BusError", "DeviceMissing", "SettingsError"} <= set(PUBLIC)


@pytest.mark.parametrize("name", sorted(PUBLIC))
def test_every_error_says_what_it_means(name):
    assert str(PUBLIC[name].__dict__["__doc__"]).strip().endswith((".", ")"))
    assert issubclass(PUBLIC[name], ImuError)


@pytest.mark.parametrize("kind", [BusError, DeviceMissing, BusBusy, BusPermission])
def test_a_bus_error_is_an_os_error_with_the_place_it_happened_at(kind):
    with pytest.raises(OSError, match=r"^look at the wires$") as caught:
        raise kind("look at the wires", errno=121, address=0x68, register=0x3B, attempts=3)
    error = caught.value
    assert type(error) is kind
    assert isinstance(error, ImuError)
    assert (error.errno, error.strerror) == (121, "look at the wires")
    assert (error.address, error.register, error.attempts) == (0x68, 0x3B, 3)
    assert error.filename is None


def test_a_bus_error_knows_nothing_it_was_not_told():
    error = BusError("look")
    assert (error.errno, error.address, error.register, error.attempts) == (None, None, None, 1)


def instance(kind: type[ImuError]) -> ImuError:
    if issubclass(kind, BusError):
        return kind("do this", errno=5, address=0x69, register=0, attempts=2)
    return kind("do this", found=0x70, known=(0x68, 0x72)) if kind is WrongChip else kind("do this")


@pytest.mark.parametrize("name", sorted(PUBLIC))
@pytest.mark.parametrize("way", [copy.copy, lambda error: pickle.loads(pickle.dumps(error))], ids=["copy", "pickle"])
def test_an_error_that_crosses_to_another_process_arrives_as_it_left(name, way):
    error = instance(PUBLIC[name])
    back = way(error)
    assert type(back) is type(error)
    assert str(back) == str(error) == "do this"
    assert back.args == error.args
    assert vars(back) == vars(error)
    assert getattr(back, "errno", None) == getattr(error, "errno", None)
