# SPDX-License-Identifier: Apache-2.0
"""What people import says what it takes and gives, and its examples run."""

import doctest
import importlib
import inspect
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / 'tools'))
public_api = importlib.import_module('public_api')

ENTRIES = [(module, name) for _, module, name in public_api.entries()]
IDS = [name for _, name in ENTRIES]


@pytest.mark.parametrize('module, name', ENTRIES, ids=IDS)
def test_it_says_what_it_takes_and_gives(module, name):
    thing = public_api.find(module, name)
    says = public_api.parts(thing)
    listed = [head for head, _ in public_api.items(says.get('Parameters', ''))]
    named = [one for head in listed for one in head.split(' : ')[0].split(', ')]
    assert named == public_api.parameters(thing)
    assert all(' : ' in head or head.startswith('*') for head in listed), 'a type is missing'
    assert says[''].splitlines()[0].endswith('.')
    gives = inspect.signature(thing).return_annotation
    if not inspect.isclass(thing) and gives not in (None, 'None'):
        assert public_api.items(says.get('Returns', says.get('Yields', '')))


@pytest.mark.slow
@pytest.mark.parametrize('module, name', ENTRIES, ids=IDS)
def test_its_example_runs(module, name, monkeypatch):
    monkeypatch.chdir(ROOT)
    thing = public_api.find(module, name)
    names = vars(importlib.import_module(module)) | {'np': np}
    (example,) = doctest.DocTestFinder(recurse=False).find(thing, name, globs=names)
    assert example.examples
    said = []
    doctest.DocTestRunner().run(example, out=said.append)
    assert not said, ''.join(said)
