# SPDX-License-Identifier: Apache-2.0
"""How long a function and how many its arguments may be; and no module imports itself."""

import ast

from test_imports import MODULES, ROOT, name

LINES, ARGUMENTS, KERNEL_LINES = 80, 8, 150
KERNELS = 'njit', 'entry', 'uncounted', 'inlined'  # the decorators of compiled code
# Functions that exceed a limit.
MORE = {
    'core/sound/mixer.py:Mixer.__init__',
}


def functions(path):
    """Yield (name, lines, arguments without self, whether it is compiled) of each function."""
    tree = ast.parse(path.read_text())
    classes = {
        id(method): f'{node.name}.'
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
        for method in node.body
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            given = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
            count = len([a for a in given if a.arg not in ('self', 'cls')])
            made = [ast.unparse(d).partition('(')[0] for d in node.decorator_list]
            compiled = any(one in KERNELS for one in made)
            yield (
                classes.get(id(node), '') + node.name,
                node.end_lineno - node.lineno + 1,
                count,
                compiled,
            )


def test_functions_are_short_and_take_few_arguments():
    for path in MODULES:
        for function, lines, arguments, compiled in functions(path):
            where = f'{name(path)}:{function}'
            if compiled:
                assert lines <= KERNEL_LINES, f'{where}: {lines} lines'
            else:
                exceeds = lines > LINES or arguments > ARGUMENTS
                words = f'{where}: {lines} lines, {arguments} arguments'
                assert exceeds == (where in MORE), words  # what needs no entry has none


def test_no_module_imports_itself_through_others():
    """Neither at the top nor inside a function."""
    known = {dotted(path): path for path in MODULES}
    edges = {module: set(imported(path, known)) - {module} for module, path in known.items()}
    while leaves := [module for module, others in edges.items() if not others & set(edges)]:
        for module in leaves:
            del edges[module]
    circle = [module for module in edges if any(module in others for others in edges.values())]
    assert not circle, f'these import each other, or what does: {circle}'


def dotted(path):
    return '.'.join(('eol_ros', *path.relative_to(ROOT).with_suffix('').parts)).removesuffix(
        '.__init__'
    )


def imported(path, known):
    tree = ast.parse(path.read_text())
    only_types = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and 'TYPE_CHECKING' in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if id(node) in only_types:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module in known:
            for alias in node.names:
                inner = f'{node.module}.{alias.name}'
                yield inner if inner in known else node.module
