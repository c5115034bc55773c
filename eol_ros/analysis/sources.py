# SPDX-License-Identifier: Apache-2.0
"""What a computation rests on: the code that it can reach, and a digest of it.

From a module or function, imports within this repository are followed, those inside functions too.
Of a module of which single names are imported, or used as `module.name`, only their definitions
count, what these use, and what runs at its import. Comments, docstrings and the words that explain
a setting or an option are left out: a change of prose makes nothing old. What is imported by a name
that the program puts together (`importlib`) is not seen: it must be named beside the root.
"""

import ast
import functools
import hashlib
from collections.abc import Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
OWN = ('eol_ros', 'benchmarks')
WHOLE = '*'  # in place of a name: all of the module
AT_IMPORT = ''  # what runs at import and binds no name
DYNAMIC = frozenset({'globals', 'vars', '__getattr__'})  # a module with one of these counts whole
Place = tuple[str, str]  # a module, and a name in it


def digest(roots: Iterable[str], root: Path = ROOT) -> str:
    """Return 12 hexadecimal digits of the code that `roots` rest on.

    Each of roots is 'package.module', which means all of it, or 'package.module.function'; root
    is the folder that holds the packages. The digits are the same in all versions of Python.
    Raises ImportError where a root, or what is imported, is not there.
    """
    found = hashlib.blake2b(digest_size=6)
    for module, statements in sorted(reached(roots, root).items()):
        found.update(f'{module}\n'.encode())
        code = _code(module, root)
        for k in sorted(statements):
            found.update(code.canonical(k).encode())
    return found.hexdigest()


def reached(roots: Iterable[str], root: Path = ROOT) -> dict[str, set[int]]:
    """Return the modules that `roots` rest on, each with the numbers of its statements that count.

    For parameters and errors see `digest`.
    """
    todo = [place for name in roots for place in _places(name, root)]
    found: dict[str, set[int]] = {}
    seen: set[Place] = set()
    while todo:
        place = todo.pop()
        if place in seen:
            continue
        seen.add(place)
        module, name = place
        code = _code(module, root)
        if module not in found:
            found[module] = set()
            parents = module.split('.')[:-1]
            todo += [('.'.join(parents[: k + 1]), AT_IMPORT) for k in range(len(parents))]
            todo.append((module, AT_IMPORT))
        if name in code.binds:
            counts = code.binds[name]
        elif _file(f'{module}.{name}', root):
            todo.append((f'{module}.{name}', WHOLE))
            continue
        else:
            raise ImportError(f'{module} binds no {name}')
        for k in counts - found[module]:
            found[module].add(k)
            todo += code.uses(k)
    return found


def _places(name: str, root: Path) -> list[Place]:
    """Return where a root is: a whole module, or a name in one."""
    if _file(name, root):
        return [(name, WHOLE)]
    module, _, inner = name.rpartition('.')
    return [(module, inner)]


def _file(module: str, root: Path) -> Path | None:
    path = root.joinpath(*module.split('.'))
    for file in (path / '__init__.py', path.with_name(f'{path.name}.py')):
        if file.is_file():
            return file
    return None


def _code(module: str, root: Path) -> '_Code':
    file = _file(module, root)
    if file is None:
        raise ImportError(f'{module}: no such module in {root}')
    return _read(module, file.read_text(encoding='utf-8'), root)


@functools.cache
def _read(module: str, text: str, root: Path) -> '_Code':
    return _Code(module, ast.parse(text), root)


class _Code:
    """The statements of a module: what each binds, and what it uses of its own and others."""

    def __init__(self, module: str, tree: ast.Module, root: Path) -> None:
        self.module = module
        self.body = [n for n in tree.body if not _is_docstring(n) and not _is_for_types(n)]
        every = set(range(len(self.body)))
        self.binds: dict[str, set[int]] = {AT_IMPORT: set()}
        for k, statement in enumerate(self.body):
            for name in _binds(statement):
                self.binds.setdefault(name, set()).add(k)
        if DYNAMIC & {n for s in self.body for n in _names(s)} or DYNAMIC & set(self.binds):
            self.binds = dict.fromkeys(self.binds, every)
        self.binds[WHOLE] = every
        self.aliases = self._aliases(root)

    def _aliases(self, root: Path) -> dict[str, str]:
        """Return the names that are modules wherever this module uses them, and which modules."""
        found: dict[str, set[str]] = {}
        for node in (n for s in self.body for n in ast.walk(s)):
            if isinstance(node, ast.ImportFrom) and _is_own(node.module or ''):
                for a in node.names:
                    module = f'{node.module}.{a.name}'
                    found.setdefault(a.asname or a.name, set()).add(
                        module if _file(module, root) else ''
                    )
            elif isinstance(node, ast.arg):
                found.setdefault(node.arg, set()).add('')
            elif isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
                found.setdefault(node.id, set()).add('')
        return {name: of.pop() for name, of in found.items() if len(of) == 1 and '' not in of}

    def uses(self, k: int) -> Iterator[Place]:
        """Yield what a statement uses: names of this module, what it imports, names in modules."""
        inner = set()  # names of modules, as in `module.name`
        for node in ast.walk(self.body[k]):
            if isinstance(node, ast.Import):
                yield from ((a.name, WHOLE) for a in node.names if _is_own(a.name))
            elif isinstance(node, ast.ImportFrom) and _is_own(node.module or ''):
                for a in node.names:
                    if (a.asname or a.name) in self.aliases:
                        yield f'{node.module}.{a.name}', AT_IMPORT
                    else:
                        yield str(node.module), a.name
            elif (
                isinstance(node, ast.Attribute)
                and isinstance(node.value, ast.Name)
                and node.value.id in self.aliases
                and not node.attr.startswith('__')
            ):
                inner.add(node.value)
                yield self.aliases[node.value.id], node.attr
        for name in (n for n in ast.walk(self.body[k]) if isinstance(n, ast.Name)):
            if name.id in self.aliases and name not in inner:
                yield self.aliases[name.id], WHOLE
            if name.id in self.binds:
                yield self.module, name.id

    def canonical(self, k: int) -> str:
        """Return a statement without docstrings, comments and layout."""
        return _canonical(self.body[k])


def _is_own(module: str) -> bool:
    return module.split('.')[0] in OWN


def _names(node: ast.AST) -> Iterator[str]:
    return (n.id for n in ast.walk(node) if isinstance(n, ast.Name))


def _binds(statement: ast.stmt) -> set[str]:
    """Return the names that a statement at the top of a module binds; AT_IMPORT if it does more.

    A definition, an import or a plain assignment does no more; all else runs at import.
    """
    names: set[str] = set()
    for node in ast.walk(statement):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names |= {a.asname or a.name.split('.')[0] for a in node.names}
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
    match statement:
        case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
            return {statement.name}
        case ast.Import() | ast.ImportFrom():
            return names
        case ast.Assign() if all(isinstance(t, ast.Name | ast.Tuple) for t in statement.targets):
            return names
        case ast.AnnAssign(target=ast.Name()):
            return names
    return names | {AT_IMPORT}


def _is_docstring(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _is_for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and 'TYPE_CHECKING' in _names(node.test)


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
