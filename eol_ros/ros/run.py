# SPDX-License-Identifier: Apache-2.0
"""The only place with rclpy.init, the executor, signals and exit codes."""

import argparse
import dataclasses
import faulthandler
import gc
import importlib
import os
import signal
import sys
import textwrap
import time
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eol_ros import scene as scenes
from eol_ros import thread_faults
from eol_ros.errors import EolError, warning_line
from eol_ros.folders import state_path
from eol_ros.ros import network
from eol_ros.ros.health_pipe import HEALTH_FD
from eol_ros.ros.session import ros
from eol_ros.streams.graph import IMAGE_SOURCES, NODES

if TYPE_CHECKING:
    from rclpy.executors import Executor

LOOK_S = 0.2  # period of the check for delayed timers
END_S = 5  # time limit for a process with a failed thread to close its devices


def node_class(name: str) -> Any:
    """Return the class of node `name`; only that node's module is imported."""
    module = importlib.import_module(f'eol_ros.nodes.{name}')
    return next(
        c for c in vars(module).values() if isinstance(c, type) and getattr(c, 'NAME', '') == name
    )


def _describe(name: str) -> str:
    lines = [f'settings of {name} (in the scene, or --ros-args -p NAME:=VALUE):']
    for f in dataclasses.fields(NODES[name].settings):
        unit = f.metadata.get('unit', '')
        lines.append(
            f'  {f.name:20} {f.default!r:14} {f.metadata.get("doc", "")}'
            + (f' [{unit}]' if unit else '')
        )
    return '\n'.join(lines)


def run(names: Sequence[str], argv: Sequence[str] | None = None) -> int:
    """Run nodes `names` in one process until SIGINT or SIGTERM; return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    split = words.index('--ros-args') if '--ros-args' in words else len(words)
    parser = argparse.ArgumentParser(
        prog=f'python -m eol_ros.nodes {" ".join(names)}',
        epilog='\n\n'.join(_describe(n) for n in names),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--scene', metavar='FILE', help='take the settings from this scene')
    args = parser.parse_args(words[:split])
    faulthandler.enable()
    try:
        scene = scenes.load(args.scene) if args.scene else scenes.Scene.alone(*names)
        return _spin(names, scene, words[split:])
    except EolError as error:
        print(f'{"+".join(names)}: {error}', file=sys.stderr, flush=True)
        return error.exit_code


def _explained(error: Exception) -> EolError:
    """Return what a callback raised as one line; rclpy has logged its traceback just now."""
    if error.__cause__ or error.__context__:  # which rclpy leaves out
        print(textwrap.indent(''.join(traceback.format_exception(error)), '  '), file=sys.stderr)
    frames = traceback.extract_tb(error.__traceback__)
    ours = Path(__file__).parent
    callback = next((f for f in frames if Path(f.filename).parent != ours), frames[-1])
    place = f'{Path(frames[-1].filename).name}:{frames[-1].lineno}'
    what = ' '.join(f'{type(error).__name__}: {error}'.split())
    return EolError(f'{callback.name}() failed with {what} ({place}); its traceback is {_log()}')


def _log() -> str:
    """Return a text that says where the traceback of a fault is."""
    return f'in {state_path() / "eol.log"}' if HEALTH_FD in os.environ else 'above'


def run_waiting(executor: 'Executor') -> None:
    """Run the callbacks that wait now; new ones may come as fast as these are done."""
    executor.spin_until_future_complete(executor.create_task(lambda: None))  # behind them all


def _spin(names: Sequence[str], scene: scenes.Scene, ros_args: list[str]) -> int:
    stop = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda n, _frame: stop.append(n))
    thread_faults.install(_log(), lambda: faulthandler.dump_traceback_later(END_S, exit=True))
    images = bool(set(IMAGE_SOURCES) & set(names))
    if scene.domain is not None:
        os.environ['ROS_DOMAIN_ID'] = str(scene.domain)
    network.configure(scene.network, images, network.asks(scene, names))

    # Messages load their types through this package, which brings its generator of message code
    # along, 3 MB with its parsers, wherever that can be imported.
    # None is how an import is refused, which the stubs do not know
    sys.modules['rosidl_generator_py.generate_py_impl'] = None  # type: ignore[assignment]
    import rclpy

    with ros(ros_args) as (executor, nodes):
        logger = rclpy.logging.get_logger(names[0])
        # warnings go to the log, one line each
        warnings.showwarning = lambda *what, **_: logger.warning(warning_line(*what[:4]))
        for name in names:
            if stop:
                break
            nodes.append(node_class(name)(scene.settings(name), scene=scene))
        gc.collect()
        gc.freeze()  # what lives now lives to the end: keep it out of every later collection
        for node in nodes:
            executor.add_node(node)
        look_s = 0.0
        rest_s = min((node.REST_S for node in nodes), default=0.0)
        while not stop:
            thread_faults.check()
            try:
                began_s = time.monotonic()
                executor.spin_once(timeout_sec=LOOK_S)
                if time.monotonic() - began_s < rest_s:  # messages come in a burst
                    time.sleep(rest_s)
                    run_waiting(executor)
            except EolError:
                raise
            except Exception as error:
                raise _explained(error) from error
            if time.monotonic() >= look_s:
                look_s = time.monotonic() + LOOK_S
                for node in nodes:
                    node.pull_in_timers()
    return 0
