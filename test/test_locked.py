# SPDX-License-Identifier: Apache-2.0
"""What the set-up installs is what setup.py allows, each wheel in one version with its hashes."""

import re
from importlib import metadata

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from support.checkout import ROOT

LOCKS = ROOT / 'tools' / 'requirements'
PYTHONS = ('3.10', '3.11', '3.12', '3.13')


def entries(name):
    """Return the requirements of a list, and how many hashes each has."""
    text = (LOCKS / f'{name}.txt').read_text().replace('\\\n', ' ')
    for line in text.splitlines():
        if line.strip():
            words = re.split(r'\s+--hash=', line.strip())
            yield Requirement(words[0]), words[1:]


def environment_of(python):
    """Return what markers are compared with, for a Python on Linux."""
    return {'python_version': python, 'python_full_version': f'{python}.9',
            'sys_platform': 'linux', 'platform_system': 'Linux',
            'implementation_name': 'cpython', 'platform_python_implementation': 'CPython',
            'os_name': 'posix', 'platform_machine': 'x86_64'}  # fmt: skip


def locked(name, python):
    """Return the versions that a Python on Linux gets, by project."""
    environment = environment_of(python)
    found = {}
    for requirement, _ in entries(name):
        if requirement.marker is None or requirement.marker.evaluate(environment):
            (version,) = requirement.specifier
            assert version.operator == '=='
            assert requirement.name not in found, f'{requirement.name} twice for {python}'
            found[canonicalize_name(requirement.name)] = version.version
    return found


def wanted(extras, python):
    """Return what the package says that it needs on a Python, as it was installed."""
    for line in metadata.requires('eol_ros'):
        requirement = Requirement(line)
        environments = [environment_of(python) | {'extra': extra} for extra in ('', *extras)]
        if requirement.marker is None or any(map(requirement.marker.evaluate, environments)):
            yield requirement


@pytest.mark.parametrize('python', PYTHONS)
@pytest.mark.parametrize(
    ('name', 'extras'), [('run', ['ros', 'science']), ('test', ['ros', 'test'])]
)
def test_all_that_setup_py_names_is_locked_in_a_version_that_it_allows(name, extras, python):
    found = locked(name, python)
    for requirement in wanted(extras, python):
        version = found[canonicalize_name(requirement.name)]
        assert requirement.specifier.contains(version), f'{requirement}: {version} is locked'


@pytest.mark.parametrize('python', PYTHONS)
def test_all_that_builds_the_messages_is_locked(python):
    text = (ROOT / 'msg_defs' / 'eol_msgs' / 'pyproject.toml').read_text()
    found = locked('messages', python)
    for line in re.findall(r'"([^"]+)"', text.partition('requires = [')[2].partition(']')[0]):
        requirement = Requirement(line)
        assert requirement.specifier.contains(found[canonicalize_name(requirement.name)]), line


@pytest.mark.parametrize('path', sorted(LOCKS.glob('*.txt')), ids=lambda path: path.stem)
def test_every_wheel_has_its_hashes(path):
    for requirement, hashes in entries(path.stem):
        assert hashes, requirement
        assert all(re.fullmatch('sha256:[0-9a-f]{64}', digest) for digest in hashes)


def test_what_runs_is_the_same_with_and_without_tests():
    for python in PYTHONS:
        assert locked('run', python).items() <= locked('test', python).items()
