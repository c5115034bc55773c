# SPDX-License-Identifier: Apache-2.0
"""eol topics: what is on the graph."""

import json

HELP = 'List the topics of the running graph, with type, publishers and readers.'
EXAMPLES = [
    'eol topics',
    'eol topics --json',
    'eol topics --markdown                          # of the source, not of the graph',
]


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('--json', action='store_true', help='as one JSON list')
    parser.add_argument('--markdown', action='store_true', help='the table of all topics there are')
    parser.add_argument('--seconds', type=float, default=5.0, metavar='S',
                        help='look around for at most so long (default 5)')
    parser.add_argument('--lan', action='store_true', help='look on the network, not only here')


def run(args):
    """Print the list."""
    if args.markdown:
        print(_markdown())
        return 0
    from eol_ros.ros.echo import on_the_graph
    from eol_ros.ros.session import session

    with session(reach='lan' if args.lan else 'local') as visit:
        own = {'/parameter_events', '/rosout'}
        names = visit.node.get_topic_names_and_types
        if visit.run(lambda: any(name not in own for name, _ in names()), args.seconds):
            visit.run(lambda: False, 1.0)  # who is there says all it has within a second
        rows = on_the_graph(visit.node)
    if args.json:
        print(json.dumps([row for row in rows if row['topic'] not in own], indent=2))
        return 0
    for row in rows:
        if row['topic'] in own:
            continue
        print(
            f'{row["topic"]:28} {row["type"]:36} {row["publishers"]} -> {row["readers"]}  '
            f'{row["doc"]}'.rstrip()
        )
    return 0


def _markdown() -> str:
    from eol_ros.ros.topics import TOPICS

    lines = ['| topic | type | given by | taken by | carries |', '| --- | --- | --- | --- | --- |']
    lines += [
        f'| `{t.name}` | `{t.type_name}` | {", ".join(t.gives)} | {", ".join(t.takes)} | {t.doc} |'
        for t in TOPICS.values()
    ]
    return '\n'.join(lines)
