"""Every public item says what it is; what it says of its arguments is so; its examples run."""

from __future__ import annotations

import ast
import dataclasses
import doctest
import importlib
import inspect
import pkgutil
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import insnav

MODULES = [insnav.__name__, *(f"insnav.{m.name}" for m in pkgutil.iter_modules(insnav.__path__) if not m.name.startswith("_"))]


def public() -> dict[str, Any]:
    """Modules, what they export, and the public members of classes, by name."""
    items: dict[str, Any] = {}
    for name in MODULES:
        module = importlib.import_module(name)
        items[name] = module
        for exported in module.__all__:
            item = getattr(module, exported)
            if exported.startswith("__") or isinstance(item, ModuleType):
                continue
            items[f"{name}.{exported}"] = item
            if inspect.isclass(item):
                for member, value in vars(item).items():
                    if not member.startswith("_") and (callable(value) or isinstance(value, (classmethod, staticmethod)) or inspect.isdatadescriptor(value)):
                        items[f"{name}.{exported}.{member}"] = getattr(item, member)
    return items


ITEMS = public()
FUNCTIONS = [
    name
    for name, item in ITEMS.items()
    if callable(item) and not inspect.isclass(item) and name.rsplit(".", 1)[0] in MODULES and item.__doc__ is not None
]


STUB = ast.parse((Path(insnav.__file__).parent / "_insnav.pyi").read_text())
NO_RESULT = {
    f"insnav.{f.name}"
    for f in STUB.body
    if isinstance(f, ast.FunctionDef) and isinstance(f.returns, ast.Constant) and f.returns.value is None
}


def section(text: str, title: str) -> str | None:
    """The lines of a section of a numpy docstring."""
    found = re.search(rf"^{title}\n-{{{len(title)}}}\n(.*?)(?=^[A-Z]\w+(?: \w+)*\n-{{3,}}$|\Z)", text, re.M | re.S)
    return found[1] if found else None


def names(lines: str) -> list[str]:
    """The names that a section explains: those at the margin, before the colon."""
    heads = (line.split(" : ")[0] for line in lines.splitlines() if line and not line[0].isspace())
    return [name.strip().lstrip("*") for head in heads for name in head.split(",")]


def is_constant(item: Any) -> bool:
    return isinstance(item, (int, float, str, tuple, frozenset))


@pytest.mark.parametrize("name", ITEMS)
def test_says_what_it_is(name: str) -> None:
    item = ITEMS[name]
    # The doc of a number is that of its type.
    if not is_constant(item) and not type(item).__name__ == "_LiteralGenericAlias":
        assert (inspect.getdoc(item) or "").strip(), name


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_parameters_are_those_of_the_signature(name: str) -> None:
    text = inspect.cleandoc(ITEMS[name].__doc__)
    expected = [p for p in inspect.signature(ITEMS[name]).parameters if p != "self"]
    told = section(text, "Parameters")
    if re.search(r"as of :(func|meth):", text):
        # The rest is told there.
        assert set(names(told or "")) <= set(expected), name
        return
    assert sorted(names(told or "")) == sorted(expected), name
    assert name in NO_RESULT or section(text, "Returns") is not None, f"{name}: no section Returns"


@pytest.mark.parametrize("name", [n for n, i in ITEMS.items() if inspect.isclass(i) and dataclasses.is_dataclass(i)])
def test_the_attributes_are_those_of_the_class(name: str) -> None:
    text = inspect.getdoc(ITEMS[name]) or ""
    told = section(text, "Attributes")
    if told is None and re.search(r"[Nn]ames, units and frames are those of :class:", text):
        return
    assert told is not None, f"{name}: no section Attributes"
    expected = [field.name for field in dataclasses.fields(ITEMS[name]) if not field.name.startswith("_")]
    assert set(expected) <= set(names(told)), set(expected) - set(names(told))


ROLE = re.compile(r":(?:func|class|meth|mod|attr|data|exc):`~?([\w.]+)`")


@pytest.mark.parametrize("name", ITEMS)
def test_what_is_referred_to_exists(name: str) -> None:
    module = max((m for m in MODULES if name == m or name.startswith(f"{m}.")), key=len)
    owner = name.rsplit(".", 1)[0]
    for target in ROLE.findall(ITEMS[name].__doc__ or ""):
        places = [target, f"{module}.{target}", f"{owner}.{target}", f"{name}.{target}", f"insnav._plot.{target}"]
        places += [f"{m}.{target}" for m in MODULES]
        assert any(resolves(place) for place in places), f"{name}: there is no {target}"


def resolves(path: str) -> bool:
    parts = path.split(".")
    for split in range(len(parts), 0, -1):
        try:
            item: Any = importlib.import_module(".".join(parts[:split]))
        except ImportError:
            continue
        try:
            for part in parts[split:]:
                item = getattr(item, part)
        except AttributeError:
            # Annotated attributes of classes that have no value there.
            return hasattr(item, "__annotations__") and parts[-1] in item.__annotations__
        return True
    return False


EXAMPLES = [name for name, item in ITEMS.items() if ">>>" in (inspect.getdoc(item) or "") and not is_constant(item)]


def test_where_a_user_would_start_there_are_examples() -> None:
    assert {"insnav", "insnav.run", "insnav.InsnavError"} <= set(EXAMPLES)


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.filterwarnings("default")
def test_examples_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = inspect.getdoc(ITEMS[name]) or ""
    for package in re.findall(r"^>>> import (matplotlib|pandas|polars|xarray|dask|distributed)", text, re.M):
        pytest.importorskip(package)
    test = doctest.DocTestParser().get_doctest(text, {}, name, None, 0)
    told: list[str] = []
    options = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
    failed, _ = doctest.DocTestRunner(optionflags=options).run(test, out=told.append)
    assert failed == 0, "".join(told)
