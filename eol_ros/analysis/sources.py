# SPDX-License-Identifier: Apache-2.0
"""A digest of the code that a computation can reach.

From a module, imports within this package are followed, those inside functions too. Comments,
docstrings and the words that explain a setting or an option are left out: a change of prose makes
nothing old. What is imported by a name that the program puts together (`importlib`) is not seen: it
must be named beside the root.
"""

import ast
import functools
import hashlib
from collections.abc import Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
OWN = 'eol_ros'


def digest(roots: Iterable[str], root: Path = ROOT) -> str:
    """Return 12 hexadecimal digits of the code that the modules `roots` rest on.

    root is the folder that holds the package. The digits are the same in all versions of Python.
    Raises ImportError where a root is not there.
    """
    found = hashlib.blake2b(digest_size=6)
    for module in sorted(reached(roots, root)):
        found.update(f'{module}\n{_canonical(_body(module, root))}'.encode())
    return found.hexdigest()


def reached(roots: Iterable[str], root: Path = ROOT) -> set[str]:
    """Return the modules that the modules `roots` rest on; raises ImportError as `digest` does."""
    todo, found = list(roots), set[str]()
    for module in todo:
        if not _file(module, root):
            raise ImportError(f'{module}: no such module in {root}')
    while todo:
        module = todo.pop()
        if module not in found and _file(module, root):
            found.add(module)
            todo += [module.rpartition('.')[0], *_imports(_body(module, root))]
    return found


def _file(module: str, root: Path) -> Path | None:
    path = root.joinpath(*module.split('.'))
    for file in (path / '__init__.py', path.with_name(f'{path.name}.py')):
        if module and file.is_file():
            return file
    return None


def _body(module: str, root: Path) -> list[ast.stmt]:
    file = _file(module, root)
    assert file is not None
    return _read(file.read_text(encoding='utf-8'))


@functools.cache
def _read(text: str) -> list[ast.stmt]:
    return [n for n in ast.parse(text).body if not _is_for_types(n)]


def _is_for_types(node: ast.stmt) -> bool:
    return isinstance(node, ast.If) and 'TYPE_CHECKING' in ast.unparse(node.test)


def _imports(body: list[ast.stmt]) -> Iterator[str]:
    """Yield what is imported of this package; a name of a module is yielded as if it were one."""
    for node in (n for statement in body for n in ast.walk(statement)):
        if isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name.split('.')[0] == OWN)
        elif isinstance(node, ast.ImportFrom) and (node.module or '').split('.')[0] == OWN:
            yield str(node.module)
            yield from (f'{node.module}.{a.name}' for a in node.names)


def _is_docstring(node: object) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _canonical(value: object) -> str:
    """Return a syntax tree as text: as `ast.dump`, which differs between versions of Python."""
    if isinstance(value, list):
        return f'[{",".join(_canonical(v) for v in value if not _is_docstring(v))}]'
    if isinstance(value, ast.Constant):
        return repr(value.value)
    if not isinstance(value, ast.AST):
        return repr(value)
    fields = dict(ast.iter_fields(value))
    if isinstance(value, ast.Call):
        fields['keywords'] = [k for k in value.keywords if k.arg != 'help']  # of `argparse`
        if isinstance(value.func, ast.Name) and value.func.id == 'setting':
            fields['args'] = [*value.args[:1], *value.args[2:]]  # without `settings.setting.doc`
    said = (f'{n}={_canonical(v)}' for n, v in sorted(fields.items()) if v not in (None, []))
    return f'{type(value).__name__}({",".join(said)})'
