# SPDX-License-Identifier: Apache-2.0
"""What can be set, node by node: what scene files, ROS parameters and docs are made from.

Plain frozen dataclasses without heavy imports, so that a scene can be checked before anything is
started. A field made with `setting(...)` carries its unit, its range and its meaning.
"""

import dataclasses
import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar, get_args


def setting(
    default: Any,
    doc: str,
    unit: str = '',
    min: float | None = None,
    max: float | None = None,
    choices: tuple[str, ...] | None = None,
    live: bool = False,
    kind: str = '',
) -> Any:
    """Return a dataclass field that knows how to be checked and explained.

    `live`: may change while the node runs. `kind` of a text: 'path', of a file or folder, relative
    to the scene file; 'optional path', which is one only if such a file is there; 'secret', shown
    to nobody: not in bags, parameters or words; or what its lines look like, one of FORMS.
    A tuple default makes a list setting; its items are checked one by one.
    """
    return field(
        default=default,
        metadata={
            'doc': doc,
            'unit': unit,
            'min': min,
            'max': max,
            'choices': choices,
            'live': live,
            'kind': kind,
            'secret': kind == 'secret',
        },
    )


live = functools.partial(setting, live=True)  # a setting that may change while the node runs


Size = TypeVar('Size', bound='TableSettings')
LEAST_BLOCKS = 4  # of a table: two by two


@dataclass(frozen=True)
class TableSettings:
    """Size and shape of the table; `core.table.Table` derives positions and springs from it."""

    rows: int = setting(5, 'number of rows of blocks, from the front to the back', '', 2, 15)
    columns: int = setting(5, 'number of columns of blocks, from left to right', '', 2, 15)
    block_side_m: float = setting(0.084, 'side of a block, which is a square', 'm', 0.02, 0.5)
    gap_m: float = setting(
        0.09,
        'length of a mounted spring: from block to block, and from block to rim',
        'm',
        0.005,
        1,
    )
    gap_y_m: float = setting(
        0.0, 'length of a mounted spring from row to row; 0: the same as gap_m',
        'm', 0, 1,
    )  # fmt: skip
    absent: tuple[int, ...] = setting(
        (), 'places without a block, by id: row * columns + column, from 0', '', 0, 224
    )
    rim_width_m: float = setting(0.014, 'width of the bars of the rim', 'm', 0.001, 0.2)
    platform_m: tuple[float, ...] = setting(
        (1.4, 1.4), 'width and depth of the platform that the rim moves on', 'm', 0.1, 10
    )
    body_height_m: float = setting(
        0.034, 'height of the body, the open box under a cover', 'm', 0.005, 0.2
    )

    def __post_init__(self) -> None:
        # as one compares them
        object.__setattr__(self, 'absent', tuple(sorted(set(self.absent))))
        object.__setattr__(self, 'gap_y_m', 0.0 if self.gap_y_m == self.gap_m else self.gap_y_m)

    @classmethod
    def parsed(cls: type[Size], values: Any) -> Size:
        """Return the table of a mapping, as files have it; raise ValueError where it is none."""
        if not isinstance(values, Mapping):
            raise ValueError(f'{values!r} is not a mapping, such as {{rows: 4, columns: 6}}')
        known = {one.name: one for one in dataclasses.fields(cls)}
        for name, value in values.items():
            if name not in known:
                raise ValueError(f'{name} is not a setting of a table')
            meta, items = known[name].metadata, get_args(known[name].type)
            if items and not isinstance(value, list):
                raise ValueError(f'{name}: {value!r} is not a list')
            kind = items[0] if items else known[name].type
            for one in value if items else [value]:
                if type(one) not in (int, kind) or not meta['min'] <= one <= meta['max']:
                    asked = f'{"whole " * (kind is int)}number ({meta["min"]} to {meta["max"]})'
                    raise ValueError(f'{name}: {one!r} is not a {asked}')
        fields: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in values.items()
        }
        table = cls(**fields)
        for name, reason in table.contradictions():
            raise ValueError(f'{name} {reason}')
        return table

    def rim_m(self) -> tuple[float, float]:
        """Return the inner width and depth of the rim."""
        gap_y_m = self.gap_y_m or self.gap_m
        return (
            self.columns * self.block_side_m + (self.columns + 1) * self.gap_m,
            self.rows * self.block_side_m + (self.rows + 1) * gap_y_m,
        )

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Yield the name of each setting that contradicts others, and the reason."""
        cells, columns, absent = self.rows * self.columns, self.columns, set(self.absent)
        blocks = cells - len(set(self.absent))
        outside = [block for block in self.absent if block >= cells]
        if outside:
            yield 'absent', f'{outside[0]} is not among the ids 0 to {cells - 1}'
        elif blocks < LEAST_BLOCKS:
            yield 'absent', f'leaves {blocks} blocks; a table has at least {LEAST_BLOCKS}'
        for row in range(1, self.rows - 1):  # outer blocks are tied to the rim
            for block in range(row * columns + 1, (row + 1) * columns - 1):
                around = {block - columns, block - 1, block + 1, block + columns}
                if block not in absent and around <= absent:
                    yield 'absent', f'leaves no spring to block {block}: nothing could move it'
        least_m = type(self).__dataclass_fields__['gap_m'].metadata['min']
        if 0 < self.gap_y_m < least_m:
            yield 'gap_y_m', f'{self.gap_y_m:g} is below {least_m:g} m; 0 means: as gap_m'
        if len(self.platform_m) != 2:
            yield 'platform_m', 'has two numbers: width and depth'
            return
        for name, rim, platform in zip(
            ('wide', 'deep'), self.rim_m(), self.platform_m, strict=True
        ):
            outer = rim + 2 * self.rim_width_m
            if platform <= outer:
                yield (
                    'platform_m',
                    f'{platform:g} m {name} is too small: the rim is {outer:.3f} m {name} outside',
                )


@dataclass(frozen=True)
class TwinSettings:
    fps: float = setting(60.0, 'image rate of the virtual camera', 'Hz', 1, 240)
    width: int = setting(1280, 'image width', 'px', 320, 4096)
    height: int = setting(800, 'image height', 'px', 200, 4096)
    exposure_us: int = setting(
        3000, 'exposure time of the virtual camera, over which motion is blurred', 'us', 50, 16000
    )
    noise: str = setting(
        'L2', 'noise level of the virtual camera', choices=('none', 'L0', 'L1', 'L2', 'L3', 'L4')
    )
    hands: str = live(
        'visitors',
        'source of the motion of the rim: simulated visitors, who let go for 20 s when a '
        'person moves it, or nobody',
        choices=('visitors', 'nobody'),
    )
    stiffness: float = setting(
        70.0,
        'stiffness of the geometric springs (its choice: docs/explanation/science.md)',
        'N/m',
        5,
        2000,
    )
    stiffness_error: float = setting(
        0.0,
        'standard error of stiffness, as printed by `eol measure springs`; 0: not measured',
        'N/m',
        0,
        2000,
    )
    spring_natural_m: float = setting(
        0.06, 'unloaded length of a spring, below its mounted length table.gap_m', 'm', 0.001, 1
    )
    block_kg: float = setting(0.25, 'mass of a block with its cover', 'kg', 0.05, 2)
    mu_static: float = setting(
        0.9,
        'mean static friction coefficient; a random factor of each block, uniform from 0.85 to '
        '1.15, multiplies it and mu_kinetic',
        '',
        0,
        2,
    )
    mu_kinetic: float = setting(
        0.6, 'mean kinetic friction coefficient of the blocks; at most mu_static', '', 0, 2
    )
    mu_static_error: float = setting(
        0.0,
        'standard error of mu_static, as printed by `eol measure friction`; 0: not measured',
        '',
        0,
        2,
    )
    mu_kinetic_error: float = setting(
        0.0,
        'standard error of mu_kinetic, as printed by `eol measure friction`; 0: not measured',
        '',
        0,
        2,
    )
    rotate: bool = setting(
        True, 'simulate the rotation of the blocks by springs that pull at their edges'
    )
    calibration: str = setting(
        '',
        'calibration file of the camera to simulate: pose, lens and cover heights; empty: an '
        'ideal camera above flat covers',
        kind='path',
    )
    mirror: bool = setting(False, 'simulate a camera that sees the table in a mirror')
    seed: int = setting(
        1, 'random seed of hands, friction of the blocks, image noise and accelerometers', '', 0
    )
    accelerometer: bool = setting(
        True,
        'simulate the accelerometers in the blocks (LIS3DH in normal mode, data sheet ST '
        'DocID17530 rev 2), which report taps',
    )


@dataclass(frozen=True)
class CameraSettings:
    device: str = setting(
        'auto',
        'camera by name or part of its name, /dev path, or file that OpenCV opens; auto: the only '
        'camera found',
        kind='optional path',
    )
    fps: float = setting(60.0, 'image rate; 0: the rate stated in a video file', 'Hz', 0, 240)
    width: int = setting(1280, 'image width', 'px', 160, 4096)
    height: int = setting(800, 'image height', 'px', 100, 4096)
    exposure_us: int = setting(3000, 'exposure time, set manually', 'us', 50, 16000)
    gain: float = setting(
        -1.0, "sensor gain in the driver's own unit; -1 leaves it unchanged", '', -1, 1000
    )
    format: str = setting('auto', 'pixel format of a live camera', choices=('auto', 'GREY', 'MJPG'))
    loop: bool = setting(True, 'start a video file again at its end')
    calibration: str = setting(
        '', 'calibration file published in camera_info; empty: none', kind='path'
    )


@dataclass(frozen=True)
class TrackerSettings:
    calibration: str = setting('', "calibration file; empty: the twin's ideal camera", kind='path')
    image_transport: str = setting(
        'raw',
        'images to take: `raw` from camera/image_raw, or JPEG from camera/image_raw/compressed '
        'of a driver that is not ours; there are no preview images then',
        choices=('raw', 'compressed'),
    )
    stamp_offset_s: float = setting(
        0.0,
        'time from the stamp that the camera driver gives an image to the middle of its exposure; '
        'half the exposure time for a driver that stamps its start, negative for one that stamps '
        'the arrival',
        's',
        -0.5,
        0.5,
    )
    mirror: bool = setting(
        False,
        'the camera sees the table in a mirror; not needed with a calibration file, which '
        'states it',
    )
    preview_hz: float = live(10.0, 'rate of the JPEG images published for viewers', 'Hz', 0.1, 30)
    trust_start: bool = setting(
        True, 'assume that the rim is turned by less than 45 degrees when the tracker starts'
    )
    blink_block: int = setting(
        -1,
        'id of the block whose infrared light blinks to show the orientation of the table; '
        '-1: none',
        '',
        -1,
        224,
    )
    blink_period_s: float = setting(2.0, 'period of the blinking of blink_block', 's', 0.5, 60)
    blink_off_s: float = setting(0.1, 'dark time in each period of blink_block', 's', 0.05, 0.2)
    background: str = setting(
        '',
        'background model (PNG) of lamps and reflections to ignore; rewritten each time it is '
        'learnt',
        kind='path',
    )


@dataclass(frozen=True)
class MotionSettings:
    stop_mps: float = live(
        0.001, 'mean speed over stop_s below which a slip has ended', 'm/s', 0, 1
    )
    stop_s: float = setting(0.1, 'averaging time of the speed for stop_mps', 's', 0.05, 0.25)
    baseline_s: float = setting(
        0.2,
        'averaging time of the rest position to which the start of a slip is compared; it must '
        'span at least 3 images',
        's',
        0.1,
        0.25,
    )
    false_alarms_per_hour: float = live(
        1.0, 'rate of false slip starts caused by noise, of all blocks together', '1/h', 1e-3, 1e5
    )
    cascade_gap_s: float = live(0.05, 'longest pause between two slips of one cascade', 's', 0, 1)
    tap_probability: float = setting(
        0.99,
        'minimum share of earlier taps that the camera confirmed, from which a tap is published '
        'as a provisional slip; 1: no provisional slips',
        '',
        0,
        1,
    )


@dataclass(frozen=True)
class LedsSettings:
    port: str = setting(
        'auto',
        'serial port of the board by name, part of its name, or path; auto: the only port found; '
        'twin: the simulated board',
    )
    trigger: str = live(
        'both',
        'event that lights a block: a tap of its own accelerometer, a slip seen by the '
        'camera, or the first of both',
        choices=('blocks', 'slips', 'both'),
    )
    tap_threshold_mg: float = live(
        16.0, 'mean acceleration over 12 ms from which a block reports a tap', 'mg', 4, 500
    )
    decay_s: float = live(
        0.1,
        'time constant of a flash; flash_limit: field or false raises a shorter one, also that of '
        'another look, to 0.182 s',
        's',
        0.02,
        10,
    )
    peak: float = live(1.0, 'peak light level of a flash', '', 0, 1)
    look: str = live(
        'paper',
        'look of the light: paper takes decay_s, spread_*, afterglow_s and idle_period_s as set; '
        'the others have their own (docs/explanation/light.md)',
        choices=('paper', 'lightning', 'wildfire', 'embers'),
    )
    spread_blocks: int = live(
        0,
        'number of blocks over which light runs on from a slip, to blocks that were dark for 1 s',
        '',
        0,
        8,
    )
    spread_delay_s: float = live(
        0.05, 'delay of running light from one block to the next', 's', 0.01, 1
    )
    spread_share: float = live(
        1.0,
        'level of a block that running light reaches, over that of the block before it; needs '
        'firmware 2.6',
        '',
        0.2,
        1,
    )
    afterglow_s: float = live(
        0.0,
        'time from a slip to a second lighting of its block, at least 1 s; 0: none. A cascade '
        'shines again in the order of its last slips, without blocks lit in the last second',
        's',
        0,
        10,
    )
    idle_period_s: float = live(
        0.0,
        'time without a slip after which dim light runs from the middle over all blocks, once in '
        'each such period; at least 1 s; needs firmware 2.6; 0: none',
        's',
        0,
        600,
    )
    idle_by_stress: bool = live(
        False,
        'idle light shows the stress of each block, from the positions of its neighbours: dark '
        'without spring force, brightest at the limit of friction',
    )
    flash_limit: str = setting(
        'field_of_view',
        'area limited to three flashes a second: each field of view of 10 degrees, from any '
        'distance, at 30 degrees or more above the table; or the whole field of blocks; false: no '
        'limit (docs/explanation/light.md)',
        choices=('field_of_view', 'field', 'false'),
    )
    flash_limit_off_because: str = setting(
        '', 'written reason for flash_limit: false, which is refused without one'
    )
    board_log: str = setting(
        '', 'CSV file that logs each frame on the wire, with port: twin; empty: none'
    )
    blink_block: int = setting(
        -1,
        'id of the block whose infrared light blinks; the same as blink_block of the tracker; '
        '-1: none',
        '',
        -1,
        224,
    )
    blink_period_s: float = setting(2.0, 'period of the blinking of blink_block', 's', 0.5, 60)
    blink_off_s: float = setting(0.1, 'dark time in each period of blink_block', 's', 0.05, 0.2)
    sleep_fade_s: float = live(
        0.0,
        'time over which walls and new flashes get dimmer when the work falls asleep, and '
        'brighter when it wakes; walls take at least 2 s; 0: flashes stop at once',
        's',
        0,
        60,
    )
    relearn_background_on_sleep: bool = live(
        True,
        'switch the infrared lights off for 1.5 s when the work falls asleep, so that the '
        'tracker learns the background again',
    )


# What a grain can be placed by; core/sound/descriptors.py defines them.
DESCRIPTORS = (
    'centroid_mean_hz',
    'periodicity_mean',
    'pitch_hz',
    'flatness',
    'rolloff95_hz',
    'rms_db',
    'loudness_lufs',
    'duration_s',
)


_NUMBER = r'[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)(e[-+]?[0-9]+)?'
_SHARE = r'(0|1|0?\.[0-9]+|[01]\.0*)'
_PATH = 'X,Y X,Y ... (2 to 100 points in 0..1)'
# What the lines of a setting look like, by the words for people.
FORMS = {
    'NAME WEIGHT': rf'\S.* {_SHARE}',
    'DESCRIPTOR WEIGHT SOURCE': rf'({"|".join(DESCRIPTORS)}) {_NUMBER} (x|y|speed|last)',
    _PATH: rf'{_SHARE},{_SHARE}( {_SHARE},{_SHARE}){{1,99}}',
    'NAME REGION': rf'\S.* (left|right|near|far|{_SHARE}(,{_SHARE}){{3}})',
}


@dataclass(frozen=True)
class GrainsSettings:
    sound: str = live(
        '',
        'audio file, folder of audio files, or corpus JSON; empty: the recording of ice',
        kind='path',
    )
    more_sounds: tuple[str, ...] = live(
        (), 'further audio files or folders for the same corpus', kind='path'
    )
    weights: tuple[str, ...] = live(
        (),
        'lines NAME WEIGHT, one for each sound: share of its grains, 0 to 1, that blocks can play. '
        'NAME is the file name without its ending, the name of its folder, or ice',
        kind='NAME WEIGHT',
    )
    regions: tuple[str, ...] = live(
        (),
        'lines NAME REGION, one for each sound: the part of the space for its grains, as left, '
        'right, near, far or X MIN,Y MIN,X MAX,Y MAX in 0..1',
        kind='NAME REGION',
    )
    paths: tuple[str, ...] = live(
        (),
        'lines X,Y X,Y ..., one for each path through the space (2 to 100 points in 0..1) along '
        'which blocks reach grains; match and panning use the own places of the blocks. The x of a '
        'block is its position along each path; its y interpolates from the first path (near) to '
        'the last (far)',
        kind=_PATH,
    )
    segment: str = live(
        'chop',
        'method that cuts the sound into grains',
        choices=('chop', 'onset', 'gate', 'none', 'labels'),
    )
    grain_s: float = live(
        0.25,
        'length of a grain; with segment: onset, the greatest length; without effect on a corpus '
        'JSON, which is cut already',
        's',
        0.02,
        60,
    )
    overlap: float = live(0.0, 'share of a grain that the next grain repeats', '', 0, 0.9)
    x_axis: str = live(
        'centroid_mean_hz',
        'descriptor mapped from left to right',
        choices=DESCRIPTORS,
    )
    y_axis: str = live(
        'periodicity_mean',
        'descriptor mapped from near to far',
        choices=DESCRIPTORS,
    )
    layout: str = live(
        'even',
        'method that places the grains in the space: by value, by rank, or evenly spread',
        choices=('raw', 'rank', 'even'),
    )
    blend: float = live(1.0, 'interpolation between descriptor values (0) and layout (1)', '', 0, 1)
    space_m: float = live(
        1.0,
        'side of the square of the table that the space covers; blocks beyond it play the grains '
        'at its edge; on another table, space_m and radius scale with the area that its '
        'blocks reach',
        'm',
        0.1,
        10,
    )
    mode: str = live(
        'fence',
        'trigger mode. With fence, each grain that a block touches sounds once. With bow, beat or '
        'chain, a moving block sounds a grain within its trigger radius at an interval, at a '
        'common beat, or at the end of its last grain. With continue, it sounds the grain that '
        'follows its last one in the recording',
        choices=('fence', 'bow', 'beat', 'chain', 'continue'),
    )
    choose: str = live(
        'all', 'selection of grains within the trigger radius', choices=('all', 'nearest', 'k')
    )
    k: int = live(3, 'number of nearest grains with choose: k', '', 1, 100)
    match: tuple[str, ...] = live(
        (),
        'lines DESCRIPTOR WEIGHT SOURCE that choose grains by descriptors, not by space: closest '
        'to the x, y or speed of the block, or to its last grain (SOURCE x, y, speed, last). The '
        'distance is a weighted distance of ranks, 0 to 1',
        kind='DESCRIPTOR WEIGHT SOURCE',
    )
    radius: float = live(0.045, 'trigger radius of a block', 'm', 0.001, 1)
    rearm_ratio: float = live(
        1.2,
        'hysteresis of the trigger radius: a block can sound the same grain again after it was '
        'farther away than radius times this ratio',
        '',
        1,
        10,
    )
    rearm_at_rest: bool = live(True, 'let grains sound again once the block is at rest')
    refractory_s: float = live(0.2, 'least time between two triggers of the same grain', 's', 0, 60)
    block_cap: int = live(20, 'greatest trigger rate of one block', '1/s', 0, 1000)
    total_cap: int = live(200, 'greatest trigger rate of all blocks together', '1/s', 0, 10000)
    bow_period_s: float = live(0.08, 'interval between grains with mode: bow', 's', 0.01, 10)
    bow_jitter: float = live(0.5, 'random variation of bow_period_s, as a share', '', 0, 1)
    beat_period_s: float = live(0.5, 'interval between beats with mode: beat', 's', 0.02, 60)
    start_mps: float = live(0.008, 'speed from which a block counts as moving', 'm/s', 0, 1)
    stop_mps: float = live(0.006, 'speed below which a moving block may be at rest', 'm/s', 0, 1)
    rest_s: float = live(
        0.03, 'time slower than stop_mps after which a block is at rest', 's', 0, 1
    )
    gain: float = live(1.0, 'gain of a grain at full speed of the block', '', 0, 8)
    gain_floor: float = live(0.1, 'gain of a grain at zero speed, as a share of gain', '', 0, 1)
    gain_curve: float = live(0.8, 'exponent of gain against speed', '', 0, 4)
    full_mps: float = live(
        0.25, 'speed of the block from which a grain has its full gain', 'm/s', 0.001, 10
    )
    pan_width: float = live(
        0.8,
        'panning of a grain at the edge of the space; 1: hard left or right, negative: sides '
        'swapped',
        '',
        -1,
        1,
    )
    playback_rate: float = live(1.0, 'playback rate of grains; 2: one octave up', '', 0.0625, 16)
    rate_jitter_st: float = live(
        0.5, 'random variation of playback_rate in either direction, in semitones', 'st', 0, 24
    )
    envelope: str = live(
        'edges',
        'envelope of a grain: fades of attack_s and release_s (edges), a window over the '
        'whole length (hann), a decay after attack_s (percussive), or a rise until release_s '
        'before the end (swell)',
        choices=('edges', 'hann', 'percussive', 'swell'),
    )
    attack_s: float = live(0.005, 'attack time of a grain', 's', 0.002, 10)
    release_s: float = live(0.2, 'release time of a grain', 's', 0.002, 10)
    edge_jitter: float = live(
        0.3, 'random variation of attack_s and release_s, as a share', '', 0, 1
    )
    ambience_rate: float = live(
        2.0,
        'ambience layer: rate of creaks of a block at rest whose springs pull as hard as its '
        'friction holds; proportional to the square of the stress; 0: off',
        '1/s',
        0,
        100,
    )
    ambience_gain: float = live(
        0.05, 'gain of a creak of the ambience layer at full stress', '', 0, 8
    )
    ambience_playback_rate: float = live(
        0.25,
        'playback rate of creaks of the ambience layer, varied at random by an octave in '
        'either direction',
        '',
        0.0625,
        16,
    )
    ambience_break_m: float = live(
        0.03,
        'elongation of one spring that moves a block at rest, mu_static m g / k',
        'm',
        0.001,
        1,
    )
    crossfade_s: float = live(
        0.0,
        'fade-in time of a new corpus; 0: each grain of the old corpus ends by itself',
        's',
        0,
        60,
    )
    seed: int = live(1, 'random seed of jitter, weights and ambience', '', 0)


@dataclass(frozen=True)
class SoundSettings:
    device: str = setting(
        'auto',
        'sound card by name or part of its name; auto: the default output; wav: a WAV file instead '
        'of a card',
    )
    card_needed: bool = setting(True, 'warn while there is no sound card')
    sample_rate: int = setting(48000, 'sample rate of the output', 'Hz', 8000, 192000)
    channels: int = setting(
        2,
        'number of outputs: loudspeakers in a row, from left to right, or as many as `speakers` '
        'names; one more with `sub_output`',
        '',
        1,
        64,
    )
    speakers: tuple[str, ...] = setting(
        (),
        'loudspeakers around the table in the order of the outputs, as NAME AZIMUTH in degrees '
        '(0 ahead, 90 left); empty: `channels` loudspeakers in a row',
    )
    block_size: int = setting(256, 'number of samples in each audio callback', '', 32, 4096)
    latency_s: float = live(0.025, 'delay between the stamp of an image and its sound', 's', 0, 1)
    tap_latency_s: float = live(
        0.0195,
        'delay between the tap of a slip that an accelerometer reported and its sound',
        's',
        0,
        1,
    )
    latency_max_s: float = live(
        0.0,
        'limit to which latency_s and tap_latency_s rise by themselves while more than 1 % of the '
        'grains are late; 0: they stay as set',
        's',
        0,
        1,
    )
    gain_db: float = live(-6.0, 'master gain (volume)', 'dB', -90, 24)
    polyphony: int = setting(
        512,
        'maximum number of simultaneous voices; beyond it the voice with the lowest gain fades '
        'out in 2 ms (is stolen)',
        '',
        1,
        4096,
    )
    rate_scaling: float = live(
        0.5,
        'share of source scaling that slows down grains: at 1 a cascade of area A plays at '
        'A^-1/2 of the playback rate; 0: off',
        '',
        0,
        1,
    )
    corner_hz: float = setting(
        5000.0,
        'corner frequency of a single slip, above which the sound falls as f^-2 (Brune 1970); '
        'A^-1/2 of it for a cascade of area A; 0: off',
        'Hz',
        0,
        24000,
    )
    low_corner_hz: float = setting(
        150.0,
        'high-pass corner of a single slip, 6 dB an octave; A^-1/2 of it for a cascade of '
        'area A; 0: off',
        'Hz',
        0,
        1000,
    )
    dynamics_db: float = live(
        3.0,
        'level difference between a grain of a single slip and one of a cascade of all '
        'blocks; 0: off',
        'dB',
        0,
        60,
    )
    onset_duck_db: float = live(
        3.0,
        'attenuation of the first grains of a cascade, which ends over onset_duck_s; 0: off',
        'dB',
        0,
        40,
    )
    onset_duck_s: float = live(
        0.05, 'time over which the attenuation onset_duck_db ends', 's', 0.001, 1
    )
    sub_db: float = live(
        -4.0,
        'level of the sub voice of a cascade of all blocks; proportional to the moment A^3/2; '
        '-90: off',
        'dB',
        -90,
        24,
    )
    sub_high_hz: float = live(
        60.0,
        'frequency of the sub voice of a single slip; A^-1/2 of it for a cascade of area A',
        'Hz',
        10,
        200,
    )
    sub_low_hz: float = live(18.0, 'lowest frequency of the sub voice', 'Hz', 10, 100)
    sub_output: bool = setting(
        False, 'play the sub voice alone on the last of `channels`, for a subwoofer or a shaker'
    )
    room_s: float = setting(
        5.0, 'reverberation time (60 dB) of the room at low frequencies; 0: no room', 's', 0, 20
    )
    room_high_s: float = setting(
        1.5, 'reverberation time (60 dB) of the room at 4 kHz', 's', 0.1, 20
    )
    room_db: float = live(
        -15.0,
        'reverberation level, relative to the direct sound, of a cascade of all blocks',
        'dB',
        -90,
        12,
    )
    room_range_db: float = live(
        12.0,
        'difference of the reverberation level between a cascade of all blocks and a single slip',
        'dB',
        0,
        60,
    )
    cascade_gap_s: float = live(
        0.15,
        'longest pause after which a block joins the cascade in which it or a neighbour sounded',
        's',
        0.01,
        2,
    )
    filter: str = live(
        'off',
        'filter of each grain, 12 dB an octave on either side of the pass band',
        choices=('off', 'low-pass', 'band-pass'),
    )
    filter_hz: float = live(
        2000.0,
        'cutoff frequency of the low-pass filter, or centre frequency of the band-pass filter',
        'Hz',
        20,
        20000,
    )
    filter_q: float = live(
        0.7071,
        'resonance of the filter: gain at the cutoff (low-pass), or centre frequency over '
        'bandwidth (band-pass)',
        '',
        0.5,
        20,
    )
    filter_by: str = live(
        'nothing',
        'quantity that moves filter_hz: none, the area of the cascade, or the rank of the '
        'grain by a descriptor of the corpus',
        choices=('nothing', 'area', *DESCRIPTORS),
    )
    filter_octaves: float = live(
        0.0,
        'shift of filter_hz between the least and the greatest value of filter_by; negative: '
        'downwards',
        'oct',
        -8,
        8,
    )
    ceiling_db: float = setting(
        -1.0, 'ceiling of the limiter, which no sample exceeds', 'dBFS', -40, 0
    )
    loudness_lufs: float = live(
        -18.0,
        'loudness, averaged over 30 s, above which the governor reduces the gain',
        'LUFS',
        -60,
        0,
    )
    governor_db: float = live(6.0, 'greatest gain reduction of the governor', 'dB', 0, 40)
    fade_in_s: float = setting(2.0, 'fade-in time at the start and after a mute', 's', 0, 60)
    fade_out_s: float = setting(0.5, 'fade-out time at the end and before a mute', 's', 0, 10)
    wav: str = setting(
        '',
        'WAV file to write while there is no sound card; empty: none, or with `device: wav` '
        'sound-DATE.wav beside the bags',
    )
    wav_limit_s: float = setting(3600.0, 'greatest length of the WAV file', 's', 1)
    meter_hz: float = setting(
        20.0,
        'rate of sound_meter messages; at most 2 if the panel runs on another machine',
        'Hz',
        1,
        60,
    )


@dataclass(frozen=True)
class MontageSettings:
    pairs: str = setting(
        '', 'folder with image pairs and pairs.csv; empty: the drawn pairs that ship', kind='path'
    )
    period_s: float = setting(
        0.5, 'time between changes of the pair while anything moves', 's', 0.34, 60
    )
    fade_s: float = setting(0.0, 'cross-fade time between pairs; 0: cut', 's', 0, 60)
    heal_s: float = setting(
        120.0,
        'time at rest after which images with degrees of damage return to the least damage',
        's',
        1,
        86400,
    )
    lead_s: float = setting(
        0.06, 'time by which a change is announced to the walls in advance', 's', 0, 1
    )
    seed: int = setting(1, 'random seed of the order of the pairs', '', 0)


@dataclass(frozen=True)
class HoursSettings:
    time_zone: str = setting('', 'time zone of the opening hours, such as Europe/Vienna')
    open: tuple[str, ...] = setting(
        (),
        'opening hours as lines of days and times, such as Tue-Sun 10:00-18:00 or 2026-12-24 '
        'closed; a later line takes precedence; 20:00-26:00 ends after midnight',
    )
    cues: tuple[str, ...] = setting(
        (),
        'lines of a cue and one of its requests, in the words of `eol call`, such as evening '
        'set leds look=embers',
    )
    cue_times: tuple[str, ...] = setting(
        (),
        'times of cues as lines of days, times and a cue, such as Fri,Sat 18:30 evening or '
        '2026-12-24 12:00 farewell; at its start the node sends the cues since the last opening or '
        'closing',
    )


@dataclass(frozen=True)
class ProjectorsSettings:
    addresses: tuple[str, ...] = setting((), 'PJLink projectors, HOST or HOST:PORT')
    password: str = setting('', 'PJLink password of all projectors; empty: none', kind='secret')
    off_after_s: float = setting(
        300.0,
        'time asleep after which the projectors are switched off; it spares the lamps during '
        'short sleeps',
        's',
        0,
        86400,
    )
    poll_s: float = setting(
        10.0, 'time between two queries of the state of the projectors', 's', 1, 600
    )


@dataclass(frozen=True)
class MachineSettings:
    name: str = setting('', 'name of this machine in `machines` of the scene; set by bringup')
    digest: str = setting('', 'SHA-256 of the scene on this machine, hex; set by bringup')


OSC_MESSAGES = (
    'block', 'tracking', 'slip', 'provisional', 'cascade', 'stress', 'lights', 'wall', 'grain',
    'descriptors', 'meter', 'state', 'health',
)  # fmt: skip


@dataclass(frozen=True)
class OscSettings:
    send_to: tuple[str, ...] = setting((), 'programs to which OSC messages are sent, HOST:PORT')
    send_from: str = setting(
        '',
        "IPv4 address of this machine's network card that sends OSC and TUIO; empty: as the "
        'routing table says',
    )
    send: tuple[str, ...] = setting((), 'OSC messages to send; empty: all', choices=OSC_MESSAGES)
    rate_hz: float = setting(30.0, 'greatest rate of poses, stress and sound meter', 'Hz', 1, 240)
    port: int = setting(
        0, 'UDP port on which requests and settings are received; 0: none', '', 0, 65535
    )
    peers: tuple[str, ...] = setting(
        (),
        'other machines that may send requests, as IPv4 addresses or networks such as 10.0.0.0/24; '
        'empty: this machine alone',
    )
    peer_rate_hz: float = setting(
        1000.0, 'greatest rate of messages taken from one machine', 'Hz', 1, 100_000
    )
    reply_port: int = setting(
        0,
        'UDP port of the sender to which replies go; 0: the port from which it sent',
        '',
        0,
        65535,
    )
    tuio: tuple[str, ...] = setting(
        (), 'programs to which the blocks are sent as TUIO 1.1 objects, HOST:PORT'
    )
    tuio2: tuple[str, ...] = setting(
        (), 'programs to which the blocks are sent as TUIO 2.0 tokens, HOST:PORT'
    )


@dataclass(frozen=True)
class MidiSettings:
    output: str = setting(
        'auto',
        'MIDI output by name or part of its name; auto: the first; virtual: a port to which '
        'other programs connect. The prefix jack: selects an output of JACK, such as jack:auto',
    )
    lowest_note: int = setting(36, 'MIDI note of block 0; block n is n notes higher', '', 0, 127)
    fastest_mps: float = setting(
        0.5, 'speed of a block at which its note has the greatest velocity', 'm/s', 0.01, 10
    )
    pressure: bool = setting(False, "send each block's stress as poly pressure of its note")
    clock: bool = setting(
        False,
        'send MIDI clock, a quarter note for each grains.beat_period_s, and Start at a beat; never '
        'Stop',
    )


@dataclass(frozen=True)
class SacnSettings:
    send_to: tuple[str, ...] = setting(
        (), 'receivers of sACN, HOST or HOST:PORT; empty: all, by multicast'
    )
    send_from: str = setting(
        '',
        "IPv4 address of this machine's network card that sends sACN; empty: as the routing "
        'table says',
    )
    universe: int = setting(1, 'DMX universe', '', 1, 63999)
    first_channel: int = setting(
        1, 'DMX channel of block 0; block n has the channel that is n higher', '', 1, 512
    )
    priority: int = setting(
        100, 'priority over other sources of the universe (E1.31); the highest counts', '', 0, 200
    )


@dataclass(frozen=True)
class PanelSettings:
    host: str = setting(
        '127.0.0.1', 'address on which the panel listens; 0.0.0.0 opens it to the network'
    )
    port: int = setting(8080, 'TCP port of the panel; 0: any free port', '', 0, 65535)
    pin: str = setting(
        '',
        'PIN required for every control; must be set if the panel is open to the network',
        kind='secret',
    )
    visitors: bool = setting(
        False, 'let everybody push the virtual table and hear it without the PIN'
    )
    public: tuple[str, ...] = setting(
        (), 'streams available to everybody without the PIN', choices=('image', 'sound')
    )
    certificate: str = setting(
        '',
        'PEM file with certificate and key, with which the panel is served over HTTPS; empty: '
        'plain HTTP',
        kind='path',
    )
    names: tuple[str, ...] = setting(
        (), 'further host names under which browsers may reach the panel'
    )
    viewers: int = setting(100, 'maximum number of connected browsers', '', 1, 1000)
    terrain_seed: int = setting(
        1, 'random seed of the landscape on the covers of the virtual table', '', 0
    )


@dataclass(frozen=True)
class RecorderSettings:
    folder: str = setting(
        'bags',
        'folder for bags, one folder a run; relative to the current folder if the scene does '
        'not set it',
        kind='optional path',
    )
    images: str = setting(
        'none',
        'images to record; preview: one JPEG each display_period_s',
        choices=('all', 'around_slips', 'preview', 'none'),
    )
    before_s: float = setting(
        0.25, 'duration of the images recorded before a slip, 60 MB a second', 's', 0, 5
    )
    after_s: float = setting(0.25, 'duration of the images recorded after a slip', 's', 0, 60)
    images_max_gb: float = setting(20.0, 'greatest amount of raw images recorded in a day', 'GB', 0)
    display_period_s: float = setting(
        1.0,
        'interval at which a preview and a sound meter message are recorded; 0: all',
        's',
        0,
        60,
    )
    split_minutes: float = setting(
        60.0, 'duration after which a new file is started', 'min', 0.05, 1440
    )
    split_gb: float = setting(4.0, 'file size after which a new file is started', 'GB', 0.001, 1000)
    sync_s: float = setting(
        1.0,
        'interval of fdatasync, which bounds what a power cut can lose; 0: never, the '
        'operating system decides',
        's',
        0,
        60,
    )
    keep_days: float = setting(
        0.0,
        'age after which bags are removed, except marked ones and those of the last 30 recorded '
        'days (of the last keep_days, if fewer); 0: never',
        'days',
        0,
    )
    keep_gb: float = setting(
        0.0,
        'total size of bags, sound files and logs above which raw images are removed first, '
        'then the oldest bags; 0: no limit',
        'GB',
        0,
    )
    min_free_gb: float = setting(2.0, 'free disk space below which recording stops', 'GB', 0)


@dataclass(frozen=True)
class ReplaySettings:
    bag: str = setting('', 'bag folder or .mcap file', kind='path')
    topics: tuple[str, ...] = setting(
        (),
        'topics to play; empty: those that the nodes of the scene subscribe to and none of '
        'them publishes',
    )
    rate: float = live(1.0, 'playback speed', '', 0.01, 100)
    fast: bool = setting(False, 'play as fast as the subscribers can follow, whatever rate says')
    loop: bool = setting(False, 'start again at the end of the bag')
    start_s: float = setting(0.0, 'start offset from the first message', 's', 0)
    wait_s: float = setting(
        60.0, 'longest wait for a first subscriber, if no scene names the nodes', 's', 0
    )


@dataclass(frozen=True)
class NotifySettings:
    webhook: str = setting(
        '',
        'URL to which messages are posted as JSON; the field `text` has the whole message',
        kind='secret',
    )
    mail_to: tuple[str, ...] = setting((), 'mail addresses to which messages are sent')
    mail_from: str = setting('', 'sender address of the mails')
    smtp: str = setting('', 'mail server, HOST:PORT')
    smtp_security: str = setting(
        'starttls',
        'encryption of the connection to the mail server',
        choices=('starttls', 'tls', 'none'),
    )
    smtp_user: str = setting('', 'user name at the mail server; empty: no login')
    smtp_password: str = setting('', 'password of smtp_user', kind='secret')
    after_s: float = setting(60.0, 'duration of a fault after which it is reported', 's', 5, 86400)
    pause_s: float = setting(
        300.0,
        'least time between two messages; changes within it are reported at its end',
        's',
        10,
        86400,
    )
    language: str = setting('en', 'language of the messages', choices=('en', 'zh-Hant'))
    daily: str = setting('20:00', 'time of day of the daily summary; empty: none')


MASK = '***'  # stands where a secret is not shown


def secrets(settings: Any) -> dict[str, str]:
    """Return what is secret in `settings` and set, by name."""
    names = [f.name for f in dataclasses.fields(settings) if f.metadata.get('secret')]
    return {name: getattr(settings, name) for name in names if getattr(settings, name)}


def masked(settings: Any) -> Any:
    """Return `settings` with a mask in place of what is secret and set."""
    return dataclasses.replace(settings, **dict.fromkeys(secrets(settings), MASK))


@functools.cache  # a fader asks for them hundreds of times a second
def fields_of(settings: type) -> Mapping[str, dataclasses.Field[Any]]:
    """Return the fields of a dataclass of settings by name."""
    return {field.name: field for field in dataclasses.fields(settings)}


@functools.cache
def _live_fields(settings: type) -> frozenset[str]:
    return frozenset(name for name, f in fields_of(settings).items() if f.metadata.get('live'))


def live_fields(settings: type) -> frozenset[str]:
    """Return the names of the settings that may change while the node runs."""
    return _live_fields(settings)  # of which mypy accepts no type[Any]


# By class, the name of a setting before and that of today; both are understood for one release.
RENAMED = {
    'MotionSettings': {'felt_probability': 'tap_probability'},
    'LedsSettings': {'knock_threshold_mg': 'tap_threshold_mg'},
    'GrainsSettings': {
        'bed_rate': 'ambience_rate',
        'bed_gain': 'ambience_gain',
        'bed_speed': 'ambience_playback_rate',
        'bed_break_m': 'ambience_break_m',
    },
    'SoundSettings': {'felt_latency_s': 'tap_latency_s', 'rupture_gap_s': 'cascade_gap_s'},
}


# The same of values; `true` was the limit of the whole field.
REPLACED = {'LedsSettings': {'flash_limit': {'True': 'field', 'true': 'field', 'False': 'false'}}}


def renamed(settings: type) -> dict[str, str]:
    """Return the names that fields of `settings` had before, each with the name of today."""
    return RENAMED.get(settings.__name__, {})


def by_today(settings: type, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return `values` of settings, as a bag or a scene has them, by the names of today."""
    before, replaced = renamed(settings), REPLACED.get(settings.__name__, {})
    return {
        before.get(name, name): replaced[name].get(str(value), value) if name in replaced else value
        for name, value in values.items()
    }
