# SPDX-License-Identifier: Apache-2.0
"""What can be set, node by node: what scene files, ROS parameters and docs are made from.

Plain frozen dataclasses without heavy imports, so that a scene can be checked before anything is
started. A field made with `setting(...)` carries its unit, its range and its meaning.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


def setting(
    default: Any,
    doc: str,
    unit: str = '',
    min: float | None = None,
    max: float | None = None,
    choices: tuple[str, ...] | None = None,
    live: bool = False,
    path: bool | str = False,
    was: str = '',
    secret: bool = False,
    form: str = '',
) -> Any:
    """Return a dataclass field that knows how to be checked and explained.

    `live`: may change while the node runs. `path`: names a file or folder, relative to the scene
    file; with 'maybe' it is one only if such a file is there. `was`: the name before, which is
    still understood, with a warning. `secret`: shown to nobody: not in bags, parameters or words.
    `form`: what a text looks like, one of FORMS.
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
            'path': path,
            'was': was,
            'secret': secret,
            'form': form,
        },
    )


@dataclass(frozen=True)
class TwinSettings:
    fps: float = setting(60.0, 'images a second', 'Hz', 1, 240)
    width: int = setting(1280, 'image width', 'px', 320, 4096)
    height: int = setting(800, 'image height', 'px', 200, 4096)
    exposure_us: int = setting(3000, 'of the virtual camera; motion blurs over it', 'us', 50, 16000)
    noise: str = setting(
        'L2', 'noise of the virtual camera', choices=('none', 'L0', 'L1', 'L2', 'L3', 'L4')
    )
    clutter: str = setting(
        'clean',
        'arms, reflections and dirt in view',
        choices=('clean', 'ordinary', 'hard', 'brutal'),
    )
    hands: str = setting(
        'visitors', 'who moves the rim while no person does: simulated visitors, who let go for'
        ' 20 s when a person touches it, or nobody', choices=('visitors', 'nobody'), live=True,
    )  # fmt: skip
    stiffness: float = setting(70.0, 'of a spring; a choice, docs/science.md', 'N/m', 5, 2000)
    stiffness_error: float = setting(
        0.0, 'standard error of stiffness, by `eol measure springs`; 0: not measured', 'N/m', 0,
        2000,
    )  # fmt: skip
    spring_natural_m: float = setting(
        0.06, 'length of a spring that nothing pulls; built in it is 0.09 m', 'm', 0.01, 0.088
    )
    block_kg: float = setting(0.25, 'mass of a block with its cover', 'kg', 0.05, 2)
    mu_static: float = setting(
        0.9, 'static friction of a block on the grit, mean of the 25; they differ by up to 15 %',
        '', 0, 2,
    )  # fmt: skip
    mu_kinetic: float = setting(0.6, 'the same while it slides; not above mu_static', '', 0, 2)
    mu_static_error: float = setting(
        0.0, 'standard error of mu_static, by `eol measure friction`; 0: not measured', '', 0, 2
    )  # fmt: skip
    mu_kinetic_error: float = setting(0.0, 'the same of mu_kinetic', '', 0, 2)
    rotate: bool = setting(True, 'springs rotate the blocks, at whose edges they pull')
    calibration: str = setting(
        '', 'calibration file of the camera to simulate: place, lens, heights of the covers;'
        ' empty: an ideal camera above flat covers', path=True,
    )  # fmt: skip
    mirror: bool = setting(False, 'the virtual camera sees the table in a mirror')
    seed: int = setting(
        1, 'of the hands, the friction of each block, the image noise and the accelerometers', '', 0
    )
    accelerometer: bool = setting(
        True, 'each block has an accelerometer and reports knocks; the part is an LIS3DH in normal'
        ' mode, figures from its data sheet, ST DocID17530 rev 2'
    )  # fmt: skip
    accelerometer_hz: float = setting(
        1344.0, 'samples a second of an accelerometer; LIS3DH, table 31', 'Hz', 1000, 5400
    )
    accelerometer_noise_ug: float = setting(
        220.0, 'its noise density; LIS3DH, table 4', 'ug/sqrt(Hz)', 0, 10_000
    )
    accelerometer_offset_mg: float = setting(
        40.0, 'standard deviation of its zero-g level; LIS3DH, table 4', 'mg', 0, 500
    )
    accelerometer_clock: float = setting(
        0.02,
        'standard deviation of the rate of its clock; no data sheet says it, a guess',
        '',
        0,
        0.2,
    )
    accelerometer_wake_hz: float = setting(
        100.0, 'samples a second while a block sleeps; LIS3DH, table 31', 'Hz', 10, 400
    )
    accelerometer_wake_mg: float = setting(
        32.0, 'what wakes a block, in steps of 16 mg; LIS3DH, INT1_THS at 2 g', 'mg', 16, 500
    )
    platform_kg: float = setting(
        40.0, 'mass of the platform, through which blocks feel each other; 140 x 140 x 3 cm of'
        ' plywood', 'kg', 5, 1000,
    )  # fmt: skip
    platform_hz: float = setting(60.0, 'how it rings; a guess', 'Hz', 10, 400)
    grit_hz: float = setting(
        250.0, 'how a block rings on its grit when it has stopped; a guess', 'Hz', 50, 600
    )
    rub_mg: float = setting(
        20.0, 'noise of grit under a block that slides at 0.1 m/s, RMS; a guess', 'mg', 0, 500
    )
    rim_hits_per_min: float = setting(
        2.0, 'knocks of hands on the rim while they move it; a guess', '1/min', 0, 600
    )
    rim_hit_mg: float = setting(
        10.0, 'peak that the platform gets from half of them; 0.1 N s, a tenth of it through the'
        ' casters, on 40 kg at 60 Hz', 'mg', 0, 2000,
    )  # fmt: skip
    footstep_mg: float = setting(
        2.0, 'peak that the platform gets from half of the footsteps, one a second; a guess', 'mg',
        0, 1000,
    )  # fmt: skip


@dataclass(frozen=True)
class CameraSettings:
    device: str = setting(
        'auto',
        'stable camera name, /dev path, genicam:NAME (or genicam:auto) for an industrial camera,'
        ' or a file that OpenCV opens',
        path='maybe',
    )
    fps: float = setting(60.0, 'images a second; 0 takes a file as it says', 'Hz', 0, 240)
    width: int = setting(1280, 'image width', 'px', 160, 4096)
    height: int = setting(800, 'image height', 'px', 100, 4096)
    exposure_us: int = setting(3000, 'manual exposure', 'us', 50, 16000)
    gain: float = setting(-1.0, "sensor gain in the driver's own unit; -1 leaves it", '', -1, 1000)
    format: str = setting('auto', 'of a live camera', choices=('auto', 'GREY', 'MJPG'))
    trigger: str = setting(
        '', 'input of a GenICam camera that starts each exposure, such as Line0; empty: none does'
    )
    stamped_at: str = setting(
        'start', 'which end of the exposure a GenICam camera stamps', choices=('start', 'end')
    )
    light_seen_s: float = setting(
        0.0, 'how long after its command a light is seen, by the stamp of its image, as `eol'
        ' measure camera` has found; nothing is corrected by it; 0: not measured', 's', -0.1, 1,
    )  # fmt: skip
    light_seen_error_s: float = setting(0.0, 'standard error of that', 's', 0, 1)
    loop: bool = setting(True, 'start a file again at its end')
    calibration: str = setting('', 'calibration file for camera_info; empty: none', path=True)


@dataclass(frozen=True)
class TrackerSettings:
    calibration: str = setting('', "calibration file; empty: the twin's ideal camera", path=True)
    mirror: bool = setting(
        False, 'the camera sees the table in a mirror; a calibration file says it by itself'
    )
    preview_hz: float = setting(10.0, 'JPEG images for people', 'Hz', 0.1, 30, live=True)
    trust_start: bool = setting(
        True, 'when the tracker starts, the rim is turned by less than 45 degrees'
    )
    blink_block: int = setting(
        -1, 'block whose infrared light blinks to show which way round all lie', '', -1, 24
    )
    blink_period_s: float = setting(2.0, 'from blink to blink', 's', 0.5, 60)
    blink_off_s: float = setting(0.1, 'how long it is dark', 's', 0.05, 0.2)
    know_covers: bool = setting(
        True, 'know each block by how its cover spreads its light, as well as by its place'
    )
    threshold: float = setting(
        0.0, 'brightness from which a spot may be a block, 0..255; 0 leaves it to contrast alone',
        '', 0, 255, live=True,
    )  # fmt: skip
    background: str = setting(
        '', 'background model (PNG): lamps and reflections to ignore; rewritten when learnt again',
        path=True, was='clutter',
    )  # fmt: skip


@dataclass(frozen=True)
class MotionSettings:
    stop_mps: float = setting(0.001, 'a block slower than this is at rest', 'm/s', 0, 1, live=True)
    stop_s: float = setting(0.1, 'time over which that speed is measured', 's', 0.05, 0.25)
    baseline_s: float = setting(
        0.2, 'average of a resting position over this time, to which a start is compared', 's',
        0.05, 0.25, was='anchor_s',
    )  # fmt: skip
    false_alarms_per_hour: float = setting(
        1.0, 'starts that noise may cause, all blocks together', '1/h', 1e-3, 1e5, live=True
    )
    cascade_gap_s: float = setting(0.05, 'pause that still joins two slips', 's', 0, 1, live=True)
    felt_probability: float = setting(
        0.99, 'a knock is told as a slip, before an image shows it, where the images have confirmed'
        ' at least this share of such knocks; 1: none is', '', 0, 1,
    )  # fmt: skip


@dataclass(frozen=True)
class LedsSettings:
    port: str = setting(
        'auto', 'serial port by stable name, auto, twin for the simulated board, or firmware for'
        " the twin's blocks and their bridge running their own programs (in a checkout, after"
        ' `make firmware`)',
    )  # fmt: skip
    radio_loss: float = setting(
        0.0, 'share of the frames between blocks and bridge that are lost, of port: firmware', '',
        0, 1,
    )  # fmt: skip
    trigger: str = setting(
        'both', 'what lights a block: its own knock, a slip that the camera saw, or whichever of'
        ' them is first', choices=('blocks', 'slips', 'both'), live=True,
    )  # fmt: skip
    knock_threshold_mg: float = setting(
        16.0, 'mean acceleration over 12 ms that a block takes for a slip (protocol version 2)',
        'mg', 4, 500, live=True,
    )  # fmt: skip
    frame_hz: float = setting(100.0, 'light levels sent while anything glows', 'Hz', 10, 500)
    baud: int = setting(1_000_000, 'speed of the serial line', '', 9600, 4_000_000)
    decay_s: float = setting(
        0.35, 'time constant of a flash; 0.182 s at least where blocks flash by themselves', 's',
        0.02, 10, live=True,
    )  # fmt: skip
    peak: float = setting(1.0, 'light of a flash', '', 0, 1, live=True)
    flash_limit: bool = setting(True, 'at most three flashes of the whole field a second')
    flash_limit_off_because: str = setting('', 'written reason, needed to switch the limit off')
    board_log: str = setting('', 'with port: twin, a CSV of each arrival on the wire')
    blink_block: int = setting(
        -1, 'block whose infrared light blinks; say the same to the tracker', '', -1, 24
    )
    blink_period_s: float = setting(2.0, 'from blink to blink', 's', 0.5, 60)
    blink_off_s: float = setting(0.1, 'how long it is dark', 's', 0.05, 0.2)
    relearn_background_on_sleep: bool = setting(
        True, 'when falling asleep, switch the infrared light off for 1.5 s, so that the tracker'
        ' learns the background again', live=True, was='clutter_at_sleep',
    )  # fmt: skip


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
# What takes longer to describe, and is described where it is asked for (core/sound/timbre.py).
MORE_DESCRIPTORS = (
    'spectral_flux',
    'attack_time_s',
    'loudness_range_lu',
    'harmonic_ratio',
    *(f'mfcc_{k}' for k in range(1, 13)),
)
# Places made of all descriptors together, for the two axes of a map.
PROJECTIONS = ('pca_1', 'pca_2', 'umap_1', 'umap_2')
MAP_AXES = (*DESCRIPTORS, *MORE_DESCRIPTORS, *PROJECTIONS)


_NUMBER = r'[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?'
_SHARE = r'(0|1|0?\.\d+|[01]\.0*)'
# What the lines of a setting look like, by the words for people.
FORMS = {
    'NAME WEIGHT': rf'\S.* {_SHARE}',
    'DESCRIPTOR WEIGHT SOURCE': rf'({"|".join(MAP_AXES)}) {_NUMBER} (x|y|speed|last)',
    'MIDI ACTION': r'(cc|note|program) (\d{1,2}:)?\d{1,3} \S.*',
    'NAME REGION': rf'\S.* (left|right|near|far|{_SHARE}(,{_SHARE}){{3}})',
}


@dataclass(frozen=True)
class GrainsSettings:
    sound: str = setting(
        '',
        'audio file, folder of audio files, or corpus JSON; empty: the procedural ice recording',
        path=True,
        live=True,
    )
    more_sounds: tuple[str, ...] = setting(
        (), 'further audio files or folders, in the same corpus', path=True, live=True
    )
    weights: tuple[str, ...] = setting(
        (), 'lines: the share, 0 to 1, of the grains of that sound that a block can'
        ' play; 0: none. NAME is that of the file without its ending, of its folder, or ice',
        live=True,
        form='NAME WEIGHT',
    )  # fmt: skip
    regions: tuple[str, ...] = setting(
        (), 'lines: the part of the space in which the grains of that sound lie: left, right, near,'
        ' far, or X MIN,Y MIN,X MAX,Y MAX in 0..1', live=True, form='NAME REGION',
    )  # fmt: skip
    segment: str = setting(
        'chop', 'how it is cut', choices=('chop', 'onset', 'gate', 'none', 'labels'), live=True
    )
    grain_s: float = setting(
        0.25, 'length of a grain, with onset its greatest', 's', 0.02, 60, live=True
    )
    overlap: float = setting(
        0.0, 'share of a grain that the next one repeats', '', 0, 0.9, live=True
    )
    more_descriptors: bool = setting(
        False, 'describe MFCC, spectral flux, attack time, loudness range and harmonic ratio, too;'
        ' an axis that is one of them does so by itself', live=True,
    )  # fmt: skip
    x_axis: str = setting(
        'centroid_mean_hz', 'descriptor from left to right; pca and umap are made of all'
        ' descriptors', choices=MAP_AXES, live=True,
    )  # fmt: skip
    y_axis: str = setting(
        'periodicity_mean', 'descriptor from near to far', choices=MAP_AXES, live=True
    )
    layout: str = setting('even', 'places in the space', choices=('raw', 'rank', 'even'), live=True)
    blend: float = setting(1.0, '0: as measured, 1: as the layout says', '', 0, 1, live=True)
    space_m: float = setting(
        1.2, 'side of the square of the table that the space covers', 'm', 0.1, 10, live=True
    )
    mode: str = setting(
        'fence', 'when: a touched grain sounds once; or a moving block sounds one of those in its'
        ' reach every so often (bow), at the beats of all (beat), when the one before has ended'
        ' (chain), or then the one that follows it in the recording (continue)',
        choices=('fence', 'bow', 'beat', 'chain', 'continue'), live=True,
    )  # fmt: skip
    choose: str = setting(
        'all', 'which grains within reach', choices=('all', 'nearest', 'k'), live=True
    )
    k: int = setting(3, 'with choose: k, the nearest so many', '', 1, 100, live=True)
    match: tuple[str, ...] = setting(
        (), 'lines: nearest are not those in place, but those whose descriptors are most like the'
        " block's x, y, speed, or the grain that it sounded last; distance is that of ranks, 0 to"
        ' 1, by weight', live=True, form='DESCRIPTOR WEIGHT SOURCE',
    )  # fmt: skip
    radius: float = setting(0.07, 'reach of a block', 'm', 0.001, 1, live=True)
    rearm_ratio: float = setting(
        1.2, 'hysteresis: a grain is armed again beyond the reach times this', '', 1, 10, live=True,
        was='leave_ratio',
    )  # fmt: skip
    rearm_at_rest: bool = setting(True, 'and also when the block comes to rest', live=True)
    refractory_s: float = setting(0.2, 'no grain sounds again sooner', 's', 0, 60, live=True)
    block_cap: int = setting(
        20, 'grains that one block may sound in a second', '1/s', 0, 1000, live=True
    )
    total_cap: int = setting(
        200, 'grains that all may sound in a second', '1/s', 0, 10000, live=True
    )
    bow_period_s: float = setting(
        0.08, 'with mode: bow, from grain to grain', 's', 0.01, 10, live=True
    )
    bow_jitter: float = setting(0.5, 'of that time, as a share', '', 0, 1, live=True)
    beat_period_s: float = setting(
        0.5, 'with mode: beat, from beat to beat', 's', 0.02, 60, live=True
    )
    start_mps: float = setting(0.008, 'a block this fast moves', 'm/s', 0, 1, live=True)
    stop_mps: float = setting(0.006, 'a block slower than this is at rest', 'm/s', 0, 1, live=True)
    rest_s: float = setting(
        0.03, 'a block is at rest once slower than `stop_mps` for this long', 's', 0, 1, live=True
    )
    gain: float = setting(1.0, 'of a grain at full speed', '', 0, 8, live=True)
    gain_floor: float = setting(0.1, 'of a grain at no speed, as a share', '', 0, 1, live=True)
    gain_curve: float = setting(0.8, 'power by which gain follows speed', '', 0, 4, live=True)
    full_mps: float = setting(0.25, 'speed of full gain', 'm/s', 0.001, 10, live=True)
    pan_width: float = setting(0.8, 'how far the edge of the space is panned', '', -1, 1, live=True)
    playback_rate: float = setting(
        1.0, 'speed of a grain; 2 is an octave up', '', 0.0625, 16, live=True, was='rate'
    )
    rate_jitter_st: float = setting(
        0.5, 'of that speed, in semitones either way', 'st', 0, 24, live=True
    )
    reverse: float = setting(
        0.0, 'share of the grains, by chance, that are played backwards', '', 0, 1, live=True
    )
    envelope: str = setting(
        'edges', 'of a grain: it rises and falls in attack_s and release_s (edges), over its whole'
        ' length (hann), falls all the while after attack_s (percussive), or rises until release_s'
        ' before its end (swell)', choices=('edges', 'hann', 'percussive', 'swell'), live=True,
    )  # fmt: skip
    attack_s: float = setting(0.005, 'rise of a grain', 's', 0.002, 10, live=True)
    release_s: float = setting(0.2, 'fall of a grain', 's', 0.002, 10, live=True)
    edge_jitter: float = setting(0.3, 'of rise and fall, as a share', '', 0, 1, live=True)
    bed_rate: float = setting(
        0.0, 'creaks a second of a block at rest whose springs pull as hard as its friction holds;'
        ' less goes by the square; 0: off', '1/s', 0, 100, live=True,
    )  # fmt: skip
    bed_gain: float = setting(0.05, 'of a creak at that stress', '', 0, 8, live=True)
    bed_speed: float = setting(
        0.25, 'speed of a creak, an octave either way by chance', '', 0.0625, 16, live=True
    )
    bed_break_m: float = setting(
        0.03, 'by how much one spring must stretch to break a block loose, mu_static m g / k'
        ' (docs/science.md)', 'm', 0.001, 1, live=True,
    )  # fmt: skip
    crossfade_s: float = setting(
        0.0, 'time in which a new corpus fades in; 0: grain by grain as the old ones end', 's', 0,
        60, live=True, was='swap_s',
    )  # fmt: skip
    seed: int = setting(1, 'of the ice recording and of all jitter', '', 0, live=True)


@dataclass(frozen=True)
class SoundSettings:
    device: str = setting('auto', 'sound card by name or part of it, auto, or wav for a file')
    card_needed: bool = setting(True, 'warn while there is none; false: a WAV file is as good')
    sample_rate: int = setting(48000, 'of the output', 'Hz', 8000, 192000)
    channels: int = setting(2, 'loudspeakers in a row, left to right', '', 1, 64)
    speakers: tuple[str, ...] = setting(
        (),
        'loudspeakers about the table, in order of the outputs: NAME AZIMUTH [DISTANCE [GAIN]] in'
        ' degrees (0 ahead, 90 left), m and dB; none: `channels` in a row, left to right',
    )
    block_size: int = setting(256, 'samples a callback', '', 32, 4096)
    latency_s: float = setting(0.025, 'from the stamp of an image to sound', 's', 0, 1, live=True)
    felt_latency_s: float = setting(
        0.0195, 'from the knock of a slip that was felt to sound', 's', 0, 1, live=True
    )
    gain_db: float = setting(-4.0, 'master gain', 'dB', -90, 24, live=True)
    interpolation: str = setting(
        'cubic', 'resampling interpolation', choices=('cubic', 'linear'), live=True, was='reading'
    )
    polyphony: int = setting(
        512, 'maximum of simultaneous voices; beyond it the quietest is stolen', '', 1, 4096,
        was='voices',
    )  # fmt: skip
    rate_scaling: float = setting(
        0.0, 'share of source scaling that slows grains down: at 1 a rupture of area A plays at'
        ' A^-1/2 of the speed; 0: off', '', 0, 1, live=True,
    )  # fmt: skip
    corner_hz: float = setting(
        0.0, 'corner frequency of a single slip; that of a rupture of area A is A^-1/2 of it,'
        ' above it the sound falls as f^-2 (Brune 1970); 0: off', 'Hz', 0, 24000,
    )  # fmt: skip
    low_corner_hz: float = setting(
        0.0, 'below it a single slip has less and less, 6 dB an octave; below A^-1/2 of it a'
        ' rupture of area A; 0: off', 'Hz', 0, 1000,
    )  # fmt: skip
    dynamics_db: float = setting(
        0.0, 'by so much a grain of a single slip is quieter than one of a rupture of all blocks;'
        ' 0: off', 'dB', 0, 60, live=True,
    )  # fmt: skip
    onset_duck_db: float = setting(
        0.0, 'by so much the first grains of a rupture are quieter, less and less over'
        ' onset_duck_s; 0: off', 'dB', 0, 40, live=True,
    )  # fmt: skip
    onset_duck_s: float = setting(
        0.05, 'time over which that ends', 's', 0.001, 1,
        live=True,
    )  # fmt: skip
    sub_db: float = setting(
        -90.0, 'level of the sub voice of a rupture of all blocks; it goes as the moment, A^3/2;'
        ' -90: off', 'dB', -90, 24, live=True,
    )  # fmt: skip
    sub_high_hz: float = setting(
        60.0, 'of the sub voice of a single slip; that of area A is A^-1/2 of it', 'Hz', 10, 200,
        live=True,
    )  # fmt: skip
    sub_low_hz: float = setting(18.0, 'the sub voice goes no lower', 'Hz', 10, 100, live=True)
    sub_output: bool = setting(
        False, 'the last of `channels` is for the sub voice alone: a subwoofer, a shaker'
    )
    room_s: float = setting(
        0.0, 'time in which the room decays by 60 dB at low frequencies; 0: no room', 's', 0, 20
    )
    room_high_s: float = setting(1.5, 'the same at 4 kHz', 's', 0.1, 20)
    room_db: float = setting(
        -6.0, 'level of the room beside the sound itself, for a rupture of all blocks', 'dB', -90,
        12, live=True,
    )  # fmt: skip
    room_range_db: float = setting(
        12.0, 'by so much less of a single slip goes into the room', 'dB', 0, 60, live=True
    )
    rupture_gap_s: float = setting(
        0.15, 'a block joins a rupture when it or a neighbour has sounded this short ago', 's',
        0.01, 2, live=True,
    )  # fmt: skip
    filter: str = setting(
        'off', 'of each grain by itself, 12 dB an octave at either side of what passes',
        choices=('off', 'low-pass', 'band-pass'), live=True,
    )  # fmt: skip
    filter_hz: float = setting(
        2000.0, 'its cutoff, or the middle of its band', 'Hz', 20, 20000, live=True
    )
    filter_q: float = setting(
        0.7071, 'its resonance: the gain at the cutoff of a low-pass, middle over width of a band',
        '', 0.5, 20, live=True,
    )  # fmt: skip
    filter_by: str = setting(
        'nothing', 'what moves the cutoff: how large the rupture has grown (area), or the rank of'
        ' the grain among all by a descriptor, where the corpus has it',
        choices=('nothing', 'area', *DESCRIPTORS, *MORE_DESCRIPTORS), live=True,
    )  # fmt: skip
    filter_octaves: float = setting(
        0.0, 'by so much: from a single slip to a rupture of all blocks, from the least to the'
        ' greatest of a descriptor; below 0: down', 'oct', -8, 8, live=True,
    )  # fmt: skip
    ceiling_db: float = setting(-1.0, 'no sample exceeds it', 'dBFS', -40, 0)
    loudness_lufs: float = setting(
        -18.0, 'mean of 30 s that the governor holds', 'LUFS', -60, 0, live=True
    )
    governor_db: float = setting(6.0, 'what the governor may take away', 'dB', 0, 40, live=True)
    fade_in_s: float = setting(2.0, 'at the start and after a mute', 's', 0, 60)
    fade_out_s: float = setting(0.5, 'at the end and to a mute', 's', 0, 10)
    wav: str = setting(
        '', 'file where there is no card; empty: none, or with `device: wav` sound-DATE.wav beside '
        'the bags'
    )  # fmt: skip
    wav_limit_s: float = setting(3600.0, 'longest such file', 's', 1)
    trigger_log: str = setting('', 'a CSV of each trigger: when it came, how long before its time')
    meter_hz: float = setting(20.0, 'sound_meter messages', 'Hz', 1, 60)
    osc_out: str = setting('', 'host:port that hears of triggers and slips by OSC')
    osc_in: int = setting(0, 'UDP port that takes settings by OSC; 0 for none', '', 0, 65535)
    midi: str = setting(
        '', 'MIDI input by name or part of it, auto for the first, virtual for a port that others'
        ' connect to, all of them with jack: before it; empty: none',
    )  # fmt: skip
    midi_map: tuple[str, ...] = setting(
        (), 'lines: what a controller, key or program does: cc|note|program [CHANNEL:]NUMBER and'
        ' NODE.SETTING [LEAST MOST], NODE.SETTING VALUE, recall PRESET or morph PRESET PRESET',
        live=True, form='MIDI ACTION',
    )  # fmt: skip


@dataclass(frozen=True)
class MontageSettings:
    pairs: str = setting('', 'folder with pairs.csv; empty: the drawn default set', path=True)
    period_s: float = setting(0.5, 'time between changes while anything moves', 's', 0.34, 60)
    fade_s: float = setting(0.0, 'cross-fade from pair to pair; 0 cuts', 's', 0, 60)
    heal_s: float = setting(
        120.0, 'time in which calm heals pictures that come in degrees of damage', 's', 1, 86400
    )
    lead_s: float = setting(0.06, 'told to the walls this long before the change', 's', 0, 1)
    seed: int = setting(1, 'of the order of the pairs', '', 0)


@dataclass(frozen=True)
class HoursSettings:
    time_zone: str = setting('', 'whose clock the hours mean, such as Europe/Vienna')
    open: tuple[str, ...] = setting(
        (),
        'lines of days and their times, such as Tue-Sun 10:00-18:00 or 2026-12-24 closed; a later '
        'line counts before an earlier one, past midnight is 20:00-26:00',
    )


@dataclass(frozen=True)
class ProjectorsSettings:
    addresses: tuple[str, ...] = setting((), 'projectors that speak PJLink, HOST or HOST:PORT')
    password: str = setting('', 'PJLink password of all; empty: they have none', secret=True)
    off_after_s: float = setting(
        300.0, 'so long after the work fell asleep they go off: a short sleep wears no lamp', 's',
        0, 86400,
    )  # fmt: skip
    poll_s: float = setting(10.0, 'time between two questions how they are', 's', 1, 600)


@dataclass(frozen=True)
class PanelSettings:
    host: str = setting('127.0.0.1', 'address to serve on; 0.0.0.0 opens it to the network')
    port: int = setting(8080, 'port to serve on; 0 takes any free one', '', 0, 65535)
    pin: str = setting(
        '', 'asked for every control; needed when the panel is open to the network', secret=True
    )
    visitors: bool = setting(
        False, 'let everybody push the virtual table and hear it without the PIN'
    )
    public: tuple[str, ...] = setting(
        (), 'what everybody may see and hear without the PIN', choices=('image', 'sound')
    )
    certificate: str = setting(
        '', 'PEM file with certificate and key; the panel is then served over HTTPS', path=True
    )
    names: tuple[str, ...] = setting((), 'further host names under which browsers may reach it')
    viewers: int = setting(100, 'browsers at the same time', '', 1, 1000)
    terrain_seed: int = setting(1, 'of the landscape on the covers of the virtual table', '', 0)


@dataclass(frozen=True)
class RecorderSettings:
    folder: str = setting(
        'bags', 'where bags are made, one folder a run; here if the scene has none', path='maybe'
    )
    images: str = setting(
        'none',
        'what is kept of the images; preview: one JPEG a display_period_s',
        choices=('all', 'around_slips', 'preview', 'none'),
    )
    before_s: float = setting(0.25, 'images kept before a slip, 60 MB a second', 's', 0, 5)
    after_s: float = setting(0.25, 'images kept after a slip', 's', 0, 60)
    images_max_gb: float = setting(20.0, 'raw images a day; no more after that', 'GB', 0)
    display_period_s: float = setting(
        1.0, 'one preview and one sound meter per so long; 0 keeps all', 's', 0, 60
    )
    split_minutes: float = setting(60.0, 'a new file after so long', 'min', 0.05, 1440)
    split_gb: float = setting(4.0, 'a new file after so much', 'GB', 0.001, 1000)
    sync_s: float = setting(
        1.0, 'seconds that a power cut can cost (fdatasync); 0: what the system has not written',
        's', 0, 60,
    )  # fmt: skip
    keep_days: float = setting(
        0.0, 'bags older than this are removed, but for marked ones; 0: never', 'days', 0
    )
    keep_gb: float = setting(
        0.0,
        'with more than this of bags, sound files and logs, raw images are removed, then the '
        'oldest; 0: never',
        'GB',
        0,
    )
    min_free_gb: float = setting(2.0, 'recording stops when the disk has less free', 'GB', 0)


@dataclass(frozen=True)
class ReplaySettings:
    bag: str = setting('', 'bag folder or .mcap file', path=True)
    topics: tuple[str, ...] = setting(
        (), 'topics to play; empty: what the nodes of the scene need and none of them makes'
    )
    rate: float = setting(1.0, 'speed of the replay', '', 0.01, 100, live=True)
    fast: bool = setting(False, 'as fast as the readers take it, whatever rate says')
    loop: bool = setting(False, 'begin again at the end')
    start_s: float = setting(0.0, 'where to begin, from the first message', 's', 0)
    wait_s: float = setting(
        60.0, 'longest wait for a first reader, where no scene says who they are', 's', 0
    )
    clock_hz: float = setting(
        100.0, 'recorded time on /clock, also while nothing is due; 0: not at all', 'Hz', 0, 1000
    )


@dataclass(frozen=True)
class NotifySettings:
    webhook: str = setting(
        '', 'address that gets messages as JSON; `text` is all of it in words', secret=True
    )
    mail_to: tuple[str, ...] = setting((), 'mail addresses that get messages')
    mail_from: str = setting('', 'mail address that they come from')
    smtp: str = setting('', 'mail server, HOST:PORT')
    smtp_security: str = setting(
        'starttls', 'how the line to it is kept secret', choices=('starttls', 'tls', 'none')
    )
    smtp_user: str = setting('', 'who logs in there; empty: nobody')
    smtp_password: str = setting('', 'of this user', secret=True)
    after_s: float = setting(60.0, 'what is not OK for so long is told', 's', 5, 86400)
    pause_s: float = setting(
        300.0, 'least time between two messages; what changes in it is told at its end', 's', 10,
        86400,
    )  # fmt: skip
    daily: str = setting('20:00', 'when the sum of the day is told; empty: never')


MASK = '***'  # stands where a secret is not shown


def secrets(settings: Any) -> dict[str, str]:
    """Return what is secret in `settings` and set, by name."""
    names = [f.name for f in dataclasses.fields(settings) if f.metadata.get('secret')]
    return {name: getattr(settings, name) for name in names if getattr(settings, name)}


def masked(settings: Any) -> Any:
    """Return `settings` with a mask in place of what is secret and set."""
    return dataclasses.replace(settings, **dict.fromkeys(secrets(settings), MASK))


def live_fields(settings: type) -> set[str]:
    """Return the names of the settings that may change while the node runs."""
    return {f.name for f in dataclasses.fields(settings) if f.metadata.get('live')}


def renamed(settings: type) -> dict[str, str]:
    """Return the names that fields of `settings` had before, each with the name of today."""
    named = {f.metadata.get('was'): f.name for f in dataclasses.fields(settings)}
    return {was: name for was, name in named.items() if was}


def by_today(settings: type, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return `values` of settings, as a bag or a scene has them, by the names of today."""
    before = renamed(settings)
    return {before.get(name, name): value for name, value in values.items()}
