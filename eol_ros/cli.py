# SPDX-License-Identifier: Apache-2.0
"""`eol VERB`: parsing only. Each verb is a module of `eol_ros.verbs`, imported when asked for."""

import argparse
import contextlib
import errno
import importlib
import io
import itertools
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NoReturn

from eol_ros import interrupts, memory
from eol_ros.errors import (
    BagDamaged,
    ConfigError,
    EolError,
    UsageError,
    nearest,
    printable,
)
from eol_ros.verbs.progress import Progress

FULL = errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO  # of a disk, at a write
GROUPS = {
    'run': {
        'run': 'start a scene',
        'check': 'check a scene and list all its mistakes',
        'kiosk': 'open the two walls full screen',
        'service': 'start at boot, watched by systemd',
        'notify': 'send a test message to the addresses of the scene',
        'keys': 'manage the keys with which other machines reach the graph',
        'backup': 'write scene, calibration and learned state into one file',
        'restore': 'put back what a backup holds',
    },
    'look': {
        'status': 'show the state of the running graph',
        'bundle': 'collect what a maintainer needs, in one file',
        'devices': 'list cameras, boards, sound cards and screens',
        'topics': 'list the topics of the running graph',
        'echo': 'print the messages of a topic',
        'param': 'list, read and change the settings of a running node',
        'call': 'send a request to the nodes, as the panel does',
    },
    'record': {
        'replay': 'play a bag',
        'bag': 'inspect, verify, repair and cut bags',
        'report': 'compute figures and numbers from a bag',
        'render': 'render the grains of a bag or a list to a sound file',
    },
    'prepare': {
        'calibrate': 'calibrate the camera',
        'camera': 'measure focus, exposure and delay of a camera',
        'board': 'list the blocks with battery and firmware; find and test them',
        'measure': 'measure springs and friction of your own table',
        'corpus': 'cut a sound into grains and describe them',
        'compile': 'compile the kernels that a first run would wait for',
    },
    'study': {
        'track': 'track the blocks in images, a video or a bag',
        'simulate': 'solve a scene of springs and blocks',
        'lattice': 'run the earthquake automaton',
        'sweep': 'compute the law of cascades over many parameters',
        'bench': 'measure error against run time, and speed against peers',
    },
}
VERBS = {verb: text for group in GROUPS.values() for verb, text in group.items()}
# that go on until they are stopped, or say themselves how far they are
LASTING = {
    'run', 'kiosk', 'echo', 'replay', 'camera', 'board', 'measure',
    'compile', 'bench', 'sweep', 'service',
}  # fmt: skip
# that decode sounds, images or films
DECODING = {
    'calibrate', 'camera', 'check', 'corpus', 'render', 'report', 'track',
}  # fmt: skip


def _overview() -> str:
    lines = ['usage: eol VERB [...]', '', 'Echoes of the Land as a ROS 2 graph.', '']
    for group, verbs in GROUPS.items():
        lines += [f'{group}:', *(f'  {verb:11} {text}' for verb, text in verbs.items()), '']
    lines += ['`eol VERB --help` explains a verb, with examples; `eol --version` names versions.']
    return '\n'.join(lines)


def _versions() -> str:
    """Return the version of the work, and of what decides what it computes, a line each."""
    from eol_ros.ros.run_record import versions

    found = versions()
    own, commit = found.pop('eol_ros', 'not installed'), found.pop('commit', '')
    lines = [f'{name} {version}' for name, version in found.items()]
    return '\n'.join([f'eol_ros {own}' + (f' ({commit})' if commit else ''), *lines])


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; return its exit code."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # names of files are bytes, and come out as such
        sys.stdout.reconfigure(errors='surrogateescape')
    try:
        try:
            return _main(list(sys.argv[1:] if argv is None else argv))
        finally:
            sys.stdout.flush()  # not when Python ends, which tells a fault in its own way
    except BrokenPipeError:
        return _unread()
    except OSError as error:
        if error.errno not in FULL:
            raise
        _unread()
        print(f'eol: {error.strerror}', file=sys.stderr)
        return ConfigError.exit_code


def _unread() -> int:
    """Let nothing be written to stdout any more; the reader has gone, as `| head` does."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _main(words: list[str]) -> int:
    if not words or words[0] in ('-h', '--help', 'help'):
        print(_overview())
        return 0
    if words[0] in ('-V', '--version', 'version'):
        print(_versions())
        return 0
    verb = words[0]
    if verb not in VERBS:
        print(f'eol: {printable(verb)}: no such verb. {nearest(verb, VERBS)}', file=sys.stderr)
        return UsageError.exit_code
    # as in the graph: the last bits of a solved system depend on how many threads solved it
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    module = importlib.import_module(f'eol_ros.verbs.{verb}')
    return run_verb(module, f'eol {verb}', words[1:])


_SENTENCES = {  # what argparse says, and what we say
    r'invalid float value: (.*)': r'\1 is not a number; units are left out',
    r'invalid int value: (.*)': r'\1 is not a whole number; units are left out',
    r'^unrecognized arguments: (-.*)': r'\1: no such option',
    r'^unrecognized arguments: (.*)': r'\1: more words than it takes',
    r': expected one argument': ' needs a value',
    r': expected at least one argument': ' needs at least one value',
    r': expected (\d+) arguments': r' needs \1 values',
    r': not allowed with argument (.*)': r' and \1 exclude each other',
    r'^one of the arguments (.*) is required': r'one of \1 is needed',
    r'^the following arguments (are required: )': r'\1',
}


class Parser(argparse.ArgumentParser):
    """Options are written in full: half of a word may be another one's, as of --seeds."""

    def __init__(self, **kwargs: Any):
        super().__init__(allow_abbrev=False, **kwargs)

    def error(self, message: str) -> NoReturn:
        """End with one sentence, in place of the whole usage and of words of argparse."""
        message = message.removeprefix('argument ')
        for form, words in _SENTENCES.items():
            message = re.sub(form, words, message)
        head, _, names = message.partition('are required: ')
        if not head:
            message = '; '.join(self._missing(name) for name in names.split(', '))
        given, unknown, _ = message.partition(': no such option')
        if unknown:
            nested = [a.choices.values() for a in self._actions if isinstance(a.choices, dict)]
            actions = [a for p in (self, *itertools.chain(*nested)) for a in p._actions]
            known = dict.fromkeys(name for a in actions for name in a.option_strings)
            message += f'. {nearest(given.split()[0].partition("=")[0], known)}'
        if found := re.search(r'invalid choice: (.*) \(choose from (.*)\)', message):
            choices = found[2].replace("'", '').split(', ')
            hint = nearest(found[1].strip("'"), choices)
            message = f'{message[: found.start()]}no such choice as {found[1]}. {hint}'
        message = printable(message)
        self.exit(UsageError.exit_code, f'{self.prog}: {message} (`{self.prog} --help` helps)\n')

    def _missing(self, name: str) -> str:
        """Return that an argument is missing, and what it is."""
        for action in self._actions:
            if name in (action.metavar, action.dest, '/'.join(action.option_strings)):
                about = ', '.join(action.choices or ()) or (action.help or '').partition(';')[0]
                return f'{name} is missing ({about})'
        return f'{name} is missing'


def within(low: float, high: float, kind: type = float) -> Callable[[str], Any]:
    """Return the `type` of an option whose value lies between `low` and `high`."""

    def read(text: str) -> Any:
        value = kind(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f'{text} is outside {low:g} to {high:g}')
        return value

    read.__name__ = kind.__name__  # argparse names it if the text is no number
    return read


def run_verb(module: Any, prog: str, words: Sequence[str]) -> int:
    """Parse `words` for the verb in `module` and run it; an expected error is one line."""
    try:
        return _run_verb(module, prog, words)
    except KeyboardInterrupt:
        interrupts.finish()
        print(f'{prog}: stopped', file=sys.stderr)
        return 0


def _run_verb(module: Any, prog: str, words: Sequence[str]) -> int:
    examples = '\n'.join(f'  {line}' for line in module.EXAMPLES)
    parser = Parser(
        prog=prog,
        description=module.HELP,
        epilog=f'examples:\n{examples}',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    module.add_arguments(parser)
    try:
        args = parser.parse_args(words)
    except SystemExit as ended:  # after --help, or after a usage error
        return int(ended.code or 0)
    damage: list[str] = []

    def show(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        if issubclass(category, BagDamaged):  # other warnings concern developers
            damage.append(str(message))
            print(f'{prog}: {printable(str(message))}', file=sys.stderr)

    warnings.showwarning = show
    try:
        interrupts.begin()
        with _watched(prog):
            return int(module.run(args) or 0) or (1 if damage else 0)
    except EolError as error:
        lines = [printable(line) for line in str(error).split('\n')]
        print(f'{prog}: {lines[0]}' if len(lines) == 1 else '\n'.join(lines), file=sys.stderr)
        return error.exit_code
    except MemoryError:
        print(f'{prog}: needs more memory than this machine has: give it less', file=sys.stderr)
        return EolError.exit_code
    except BrokenPipeError:
        return _unread()
    except (ModuleNotFoundError, OSError) as error:
        known = _explained(error, args)
        if known is None:
            raise
        print(f'{prog}: {printable(str(known))}', file=sys.stderr)
        return known.exit_code
    finally:
        interrupts.finish()


@contextlib.contextmanager
def _watched(prog: str) -> Iterator[None]:
    """Bound the memory of a verb that ends by itself, and let it say what it does if it is long."""
    verb = prog.removeprefix('eol ')
    with contextlib.ExitStack() as stack:
        if verb in DECODING:
            stack.enter_context(_libraries_unheard())
        if verb in VERBS and verb not in LASTING:
            stack.enter_context(memory.bounded())
            stack.enter_context(Progress(f'{prog}: {VERBS[verb]}'))
        yield


@contextlib.contextmanager
def _libraries_unheard() -> Iterator[None]:
    """Discard what libraries in C print to file descriptor 2; `sys.stderr` goes on.

    Decoders of MP3, JPEG, TIFF and video print each fault that they meet, and few can be told not
    to. The verb says itself what is wrong with a file.
    """
    python = sys.__stderr__
    if not python:  # file descriptor 2 was closed before the start, and may be any file now
        yield
        return
    with open(os.dup(2), 'w', 1, python.encoding, python.errors) as ours:
        used = sys.stderr is python  # else it has been replaced, and writes elsewhere
        with contextlib.redirect_stderr(ours) if used else contextlib.nullcontext():
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, 2)
            os.close(nothing)
            try:
                yield
            finally:
                os.dup2(ours.fileno(), 2)


def _explained(error: ModuleNotFoundError | OSError, args: argparse.Namespace) -> EolError | None:
    """Return what to do about what others' code has raised; None for a fault of ours."""
    if isinstance(error, OSError):
        # a full disk is told of no file: it is the one that was asked for
        where = error.filename or (error.errno in FULL and _output(args))
        return ConfigError(f'{where}: {error.strerror}') if where else None
    from eol_ros.ros import installed

    return installed.explained(error)


def _output(args: argparse.Namespace) -> str | None:
    return getattr(args, 'output', None) or getattr(args, 'out', None)


if __name__ == '__main__':
    sys.exit(main())
