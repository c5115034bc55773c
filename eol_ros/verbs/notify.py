# SPDX-License-Identifier: Apache-2.0
"""eol notify: do messages arrive where the scene sends them?"""

import json
import sys

from eol_ros import scene as scenes
from eol_ros.bringup import notify
from eol_ros.errors import ConfigError, EolError
from eol_ros.said import said

HELP = (
    'Send a test message through each channel under `notify` of the scene (webhook, mail) and '
    'print the answer of each server. No graph needs to run. Exit code 1 if a server rejects its '
    'message.'
)
EXAMPLES = ['eol notify museum', 'eol notify my/scene.yaml --json']


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument(
        'scene', nargs='?', default='museum', help='scene file, or name of a shipped scene'
    )
    parser.add_argument('--json', action='store_true', help='print the answers as one JSON object')


def run(args):
    """Send it by each way; return 0 where all have taken it."""
    scene = scenes.load(args.scene)
    if scene.notify is None:
        raise ConfigError(
            f'{scene.path}: no receiver of notifications; add notify: {{webhook: URL}}'
        )
    notify.check(scene.notify)
    texts = said('test_message'), (said('asked_for'),)
    message = notify.Message('test', scene.name, *texts, scene.notify.language)
    answers = {}
    for way in notify.ways(scene.notify):
        try:
            answers[way.name] = {'ok': True, 'answer': way.send(message)}
        except EolError as error:
            answers[way.name] = {'ok': False, 'answer': str(error)}
    if args.json:
        print(json.dumps(answers))
    else:
        for name, told in answers.items():
            print(f'{name}: {told["answer"]}', file=sys.stdout if told['ok'] else sys.stderr)
    return 0 if all(told['ok'] for told in answers.values()) else 1
