# SPDX-License-Identifier: Apache-2.0
"""The graph in two tables: what each node publishes and subscribes to, and what each topic is.

A new node is a module in `nodes`, a dataclass of settings and one row here; scene files, quality of
service, the startup barrier, priorities and the tables in the docs are made from these. Names of
topics are relative to the namespace, but for those that begin with a slash. The last functions are
the only place that puts the two together.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

from eol_ros import settings

NAMESPACE = 'eol'  # of a graph whose scene names none
MAX_DOMAIN = 101  # above, DDS takes ports that the system gives to anybody
EVERY_NODE = 'every node'
OF_ROS = {'/parameter_events', '/rosout'}  # of every rclpy node, and not in the table
INSTRUMENT = ('grains', 'sound')  # whose live settings are played, and make a preset
LONG, SHORT = 1, 2  # real-time priority of what works for milliseconds an image, and of the rest


@dataclass(frozen=True)
class NodeSpec:
    """One node.

    settings: its dataclass. on_request: what it publishes beside, but only when people ask for
    it. optional: what it subscribes to only where a setting asks for it, and nobody waits for.
    requires: the topic without which it has nothing to do. images: it is a source of images, of
    which a scene has one at most. real_time: the priority of what stands between an image or a
    knock and what people see and hear of it; 0: none. nice: how much it gives way when both
    processors are wanted.
    """

    name: str
    settings: type
    publishes: tuple[str, ...] = ()
    on_request: tuple[str, ...] = ()
    subscribes: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    requires: str = ''
    images: bool = False
    real_time: int = 0
    nice: int = 0


@dataclass(frozen=True)
class QoS:
    """Quality of service: keep the last `depth` messages; `latched` is transient local.

    sent: what a publisher keeps, where that is less than what a subscriber asks for.
    """

    depth: int
    reliable: bool = True
    latched: bool = False
    sent: int = 0


@dataclass(frozen=True)
class TopicSpec:
    """One topic: type, name of its quality of service, what it carries, and who uses it.

    barrier: the source of images starts when publishers and subscribers of the scene have matched.
    stamped: its stamp is that of an image or a tap; subscribers reject one that is not of now.
    sensor: drivers of others publish it, best effort too, which is taken where no more is offered.
    sources: the publishers without those who publish only what people ask for.
    """

    name: str
    type_name: str
    qos: str
    doc: str
    barrier: bool = False
    stamped: bool = False
    sensor: bool = False
    sources: tuple[str, ...] = ()
    publishers: tuple[str, ...] = ()
    subscribers: tuple[str, ...] = ()


# Who takes requests answers them, and tells of settings that were changed by its parameters.
_ANSWERS = ('requests', 'request_results')

# In data order: a node stands after those whose topics it subscribes to.
# fmt: off
_NODES = (
    NodeSpec('twin', settings.TwinSettings, images=True, real_time=LONG,
             publishes=('camera/image_raw', 'camera/camera_info', 'truth'), on_request=_ANSWERS,
             subscribes=('rim_command', 'requests')),
    NodeSpec('camera', settings.CameraSettings, images=True, real_time=LONG,
             publishes=('camera/image_raw', 'camera/camera_info')),
    NodeSpec('replay', settings.ReplaySettings, images=True, real_time=LONG,
             publishes=('camera/image_raw', 'camera/camera_info', 'truth', 'blocks', 'block_taps',
                        'slips', 'felt_slips', 'cascades', 'grain_triggers', 'felt_triggers',
                        'requests', '/clock')),
    NodeSpec('tracker', settings.TrackerSettings, requires='camera/image_raw', real_time=LONG,
             publishes=('blocks', 'camera/image_raw/compressed', 'calibration', 'table',
                        *_ANSWERS),
             subscribes=('camera/image_raw', 'block_taps', 'requests'),
             optional=('camera/image_raw/compressed', 'camera/camera_info')),
    NodeSpec('motion', settings.MotionSettings, requires='blocks', real_time=SHORT,
             publishes=('slips', 'felt_slips', 'cascades'), on_request=_ANSWERS,
             subscribes=('blocks', 'block_taps', 'requests')),
    NodeSpec('leds', settings.LedsSettings, requires='slips', real_time=SHORT,
             publishes=('led_commands', 'block_taps', 'requests'),
             on_request=('request_results',),
             subscribes=('slips', 'block_taps', 'requests'), optional=('blocks', 'node_states')),
    NodeSpec('grains', settings.GrainsSettings, requires='blocks', real_time=SHORT,
             publishes=('grain_triggers', 'felt_triggers', 'corpus'), on_request=_ANSWERS,
             subscribes=('blocks', 'felt_slips', 'requests')),
    NodeSpec('sound', settings.SoundSettings, requires='grain_triggers', real_time=SHORT,
             publishes=('sound_meter', 'sound_samples'), on_request=('grain_triggers', *_ANSWERS),
             subscribes=('grain_triggers', 'felt_triggers', 'corpus', 'requests'),
             optional=('slips', 'node_states', 'request_results')),
    NodeSpec('montage', settings.MontageSettings, requires='slips', nice=3,
             publishes=('wall',), on_request=_ANSWERS,
             subscribes=('slips', 'requests')),
    NodeSpec('hours', settings.HoursSettings, nice=3,
             publishes=('requests',), on_request=('request_results',),
             subscribes=('requests', 'request_results')),
    NodeSpec('projectors', settings.ProjectorsSettings, nice=3,
             on_request=_ANSWERS, subscribes=('requests',)),
    NodeSpec('machine', settings.MachineSettings, nice=3, on_request=_ANSWERS,
             subscribes=('node_states', 'requests')),
    NodeSpec('osc', settings.OscSettings, real_time=SHORT, on_request=('requests',),
             optional=('blocks', 'slips', 'felt_slips', 'cascades', 'led_commands', 'wall',
                       'corpus', 'grain_triggers', 'felt_triggers', 'sound_meter', 'work_state',
                       'node_states', 'request_results')),
    NodeSpec('midi', settings.MidiSettings, requires='slips', real_time=SHORT,
             subscribes=('slips', 'cascades'), optional=('blocks', 'request_results')),
    NodeSpec('sacn', settings.SacnSettings, requires='led_commands', real_time=SHORT,
             subscribes=('led_commands',)),
    NodeSpec('panel', settings.PanelSettings, nice=3,
             publishes=('work_state', 'markers', 'block_poses', '/tf_static'),
             on_request=('rim_command', *_ANSWERS),
             subscribes=('camera/image_raw/compressed', 'calibration', 'truth', 'blocks',
                         'slips', 'cascades', 'led_commands', 'corpus', 'grain_triggers',
                         'sound_meter', 'sound_samples', 'wall', 'requests', 'request_results',
                         'node_states')),
    NodeSpec('recorder', settings.RecorderSettings, nice=3,
             subscribes=('camera/image_raw', 'camera/camera_info', 'camera/image_raw/compressed')),
)

QOS = {
    # 1 MB each: 20 bridge a third of a second of a busy subscriber. DDS threads answer in time even
    # where the Python of the subscriber is busy: the twelve last to send again save 8 MB.
    'images': QoS(20, sent=12),
    # Small, one per image or per event. A node that had no processor for 2 s loses none, even
    # behind a replay at four times the pace: DDS acknowledges what is queued, not what is taken.
    # A process whose DDS threads had none loses nothing for 5 s.
    'stream': QoS(600, sent=300),
    'preview': QoS(10, reliable=False),
    'meter': QoS(10, reliable=False),
    'latched': QoS(10, latched=True),
    'state': QoS(32, latched=True, sent=1),  # the last of each node
    'health': QoS(10),
    'clock': QoS(1, reliable=False),  # as rclcpp and rclpy ask for it
}

_TOPICS = (
    TopicSpec('rim_command', 'eol_msgs/msg/RimCommand', 'stream', 'hands on the rim of the twin'),
    TopicSpec('camera/image_raw', 'sensor_msgs/msg/Image', 'images',
              'the infrared image, mono8', barrier=True, stamped=True, sensor=True),
    TopicSpec('camera/camera_info', 'sensor_msgs/msg/CameraInfo', 'stream',
              'lens of the camera, with the stamp of each image; only while subscribed',
              barrier=True, stamped=True, sensor=True),
    TopicSpec('camera/image_raw/compressed', 'sensor_msgs/msg/CompressedImage', 'preview',
              'JPEG for people, only while subscribed', stamped=True),
    TopicSpec('calibration', 'eol_msgs/msg/Calibration', 'latched',
              'camera and table as the tracker maps pixels to metres'),
    TopicSpec('table', 'eol_msgs/msg/Table', 'latched',
              'size and shape of the table of the scene'),
    TopicSpec('truth', 'eol_msgs/msg/Truth', 'stream', 'true state of the simulated table',
              stamped=True),
    TopicSpec('blocks', 'eol_msgs/msg/Blocks', 'stream',
              'the blocks, once per image', barrier=True, stamped=True),
    TopicSpec('block_taps', 'eol_msgs/msg/BlockTap', 'stream',
              "taps measured by the blocks' accelerometers", stamped=True),
    TopicSpec('slips', 'eol_msgs/msg/Slip', 'stream',
              'a block starts to move, or stops', barrier=True, stamped=True),
    TopicSpec('felt_slips', 'eol_msgs/msg/FeltSlip', 'stream',
              'provisional slips from taps, later confirmed or retracted by the camera',
              barrier=True, stamped=True),
    TopicSpec('cascades', 'eol_msgs/msg/Cascade', 'stream',
              'slips joined in time and neighbourhood', barrier=True, stamped=True),
    TopicSpec('led_commands', 'eol_msgs/msg/LedCommand', 'stream',
              'levels sent to the LEDs of the blocks'),
    TopicSpec('corpus', 'eol_msgs/msg/Corpus', 'latched', 'all grains and their places'),
    TopicSpec('grain_triggers', 'eol_msgs/msg/GrainTrigger', 'stream',
              'grains to play', barrier=True, stamped=True),
    TopicSpec('felt_triggers', 'eol_msgs/msg/GrainTrigger', 'stream',
              'grains for provisional slips; `grain_triggers` repeats them for the same slips',
              barrier=True, stamped=True),
    TopicSpec('sound_meter', 'eol_msgs/msg/SoundMeter', 'meter',
              'waveform, spectrum and counters of the sound'),
    TopicSpec('sound_samples', 'eol_msgs/msg/SoundSamples', 'meter',
              "the engine's output, only while subscribed"),
    TopicSpec('wall', 'eol_msgs/msg/Wall', 'latched', 'the pair on the two walls'),
    TopicSpec('markers', 'visualization_msgs/msg/MarkerArray', 'stream',
              'table, rim, blocks, springs, slips for RViz; only while subscribed'),
    TopicSpec('block_poses', 'geometry_msgs/msg/PoseArray', 'stream',
              'poses of the blocks by id, NaN where unknown; only while subscribed'),
    TopicSpec('/tf_static', 'tf2_msgs/msg/TFMessage', 'latched',
              'frames of tf: world -> table -> camera_optical, by the calibration'),
    TopicSpec('requests', 'eol_msgs/msg/Request', 'stream',
              'requests to nodes, from the panel, the command line or other nodes'),
    TopicSpec('request_results', 'eol_msgs/msg/RequestResult', 'stream',
              'result of each request, with the stamp from which it takes effect'),
    TopicSpec('ready', 'std_msgs/msg/Empty', 'latched',
              'startup barrier, without data: a node subscribes once it has discovered its peers',
              publishers=('twin', 'camera', 'replay'), subscribers=(EVERY_NODE,)),
    TopicSpec('node_states', 'eol_msgs/msg/NodeState', 'state',
              'state of each node, once a second and at each change of level',
              publishers=(EVERY_NODE,)),
    TopicSpec('work_state', 'eol_msgs/msg/NodeState', 'state',
              'state of the whole work, as pages and `eol status` show it; at each change'),
    TopicSpec('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', 'health',
              'node_states for ROS tools, by names as `eol: sound`; STARTING is WARN',
              publishers=(EVERY_NODE,)),
    TopicSpec('/clock', 'rosgraph_msgs/msg/Clock', 'clock',
              'recorded time, for nodes that use_sim_time', subscribers=(EVERY_NODE,)),
)
# fmt: on


def _used(topic: TopicSpec) -> TopicSpec:
    """Return the topic with the nodes that publish it and those that subscribe to it."""
    sources = tuple(node.name for node in _NODES if topic.name in node.publishes)
    others = tuple(node.name for node in _NODES if topic.name in node.on_request)
    subscribers = tuple(node.name for node in _NODES if topic.name in node.subscribes)
    return replace(
        topic,
        sources=sources + topic.publishers,
        publishers=sources + others + topic.publishers,
        subscribers=subscribers + topic.subscribers,
    )


NODES: dict[str, NodeSpec] = {node.name: node for node in _NODES}
TOPICS: dict[str, TopicSpec] = {topic.name: _used(topic) for topic in _TOPICS}
FORMER_TYPES = {'calibration': 'std_msgs/msg/String'}  # in bags up to version 0.2
IMAGE_SOURCES = tuple(node.name for node in _NODES if node.images)


def providers(node: str) -> tuple[str, ...]:
    """Return the nodes of which one must publish what `node` requires: in a scene, or elsewhere."""
    topic = NODES[node].requires
    return TOPICS[topic].sources if topic else ()


def counted(topic: str) -> bool:
    """Return whether the numbers of its messages tell what was lost: they have one source.

    Sources of images, a replay among them, stand for each other; one node more may publish what
    people ask for.
    """
    row = TOPICS[topic]
    sources = set(row.sources) - set(IMAGE_SOURCES)
    asked = set(row.publishers) - set(row.sources)
    return bool(row.sources) and EVERY_NODE not in sources and max(len(sources), len(asked)) <= 1


def full_name(topic: str, namespace: str = NAMESPACE) -> str:
    """Return the name of a topic on the graph: `slips` is `/eol/slips`, `diagnostics` no other."""
    if topic.startswith('/'):
        return topic
    if f'/{topic}' in TOPICS or not namespace:
        return f'/{topic}'
    return f'/{namespace}/{topic}'


def relative_name(name: str, namespace: str = NAMESPACE) -> str:
    """Return a full name without its namespace, if it is in that one."""
    return name if name in TOPICS else name.removeprefix(full_name('', namespace))


def topic_of(name: str, namespace: str = NAMESPACE) -> TopicSpec | None:
    """Return the row of the topic with a full name, or None."""
    return TOPICS.get(relative_name(name, namespace))


def frame_prefix(namespace: str) -> str:
    """Return what stands before `table` in a graph of this namespace: nothing in the usual one."""
    return '' if namespace == NAMESPACE else f'{namespace}/'


def status_name(node: str, namespace: str) -> str:
    """Return what a node is called on /diagnostics, which all graphs of a domain share."""
    return f'{namespace}: {node}'


def namespace_of(types: Mapping[str, str]) -> str:
    """Return the namespace of recorded topics, type by full name: where most of the table are.

    '' is the root; without any of the table it is the usual one.
    """
    found = Counter(
        name.removesuffix(topic.name).strip('/')
        for name, kind in types.items()
        for topic in _TOPICS
        if topic.type_name == kind and f'/{topic.name}' == name[-len(topic.name) - 1 :]
    )
    return found.most_common(1)[0][0] if found else NAMESPACE
