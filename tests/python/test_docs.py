"""Docstrings: everything public has one, examples run, and the stubs name what is there."""

import ast
import doctest
import importlib
import inspect
import pathlib
import pkgutil

import numpy
import pytest
from conftest import QUICK

import isolume
from isolume import _isolume

PACKAGE = pathlib.Path(isolume.__file__).parent


def test_examples_run(tmp_path):
    store = isolume.open("bumpbox:24").bake(47, store=tmp_path / "examples.isolume", **QUICK)
    names = dict(isolume=isolume, numpy=numpy, store=store, folder=tmp_path)
    tried = 0
    for module in pkgutil.iter_modules([str(PACKAGE)]):
        if module.name in ("__main__", "_isolume"):
            continue
        found = importlib.import_module(f"isolume.{module.name}")
        results = doctest.testmod(found, extraglobs=names, optionflags=doctest.NORMALIZE_WHITESPACE)
        assert results.failed == 0, module.name
        tried += results.attempted
    results = doctest.testmod(isolume, extraglobs=names, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert results.failed == 0 and tried + results.attempted > 15


def test_everything_public_is_documented():
    for name in isolume.__all__:
        item = getattr(isolume, name)
        assert inspect.getdoc(item), name
        if not inspect.isclass(item):
            continue
        members = [m for m in vars(item) if not m.startswith("_")]
        undocumented = [m for m in members if isinstance(vars(item)[m], property) and not inspect.getdoc(vars(item)[m])]
        undocumented += [m for m in members if inspect.isfunction(vars(item)[m]) and not inspect.getdoc(vars(item)[m])]
        assert not undocumented, (name, undocumented)


def test_stubs_name_what_is_there():
    tree = ast.parse((PACKAGE / "_isolume.pyi").read_text())
    stated = {node.name: node for node in tree.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
    there = {name for name in dir(_isolume) if not name.startswith("_")}
    assert stated.keys() == there
    for name, node in stated.items():
        if isinstance(node, ast.ClassDef):
            members = {item.name for item in node.body if isinstance(item, ast.FunctionDef)}
            assert members == {m for m in dir(getattr(_isolume, name)) if not m.startswith("_")}, name
    assert (PACKAGE / "py.typed").is_file()


@pytest.mark.parametrize("made", [isolume.Volume, isolume.Store, isolume.Surface])
def test_what_others_make_says_so(made):
    with pytest.raises(TypeError, match="made by"):
        made()
