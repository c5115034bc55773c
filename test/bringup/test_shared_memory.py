# SPDX-License-Identifier: Apache-2.0
"""Ports that a killed process left half made, before real participants of Fast DDS."""

import contextlib
import os
import select
import signal
import subprocess
import sys
import time

import pytest
from support.domains import next_domain
from support.waiting import wait_until

from eol_ros.bringup import shared_memory

PARTICIPANT = """
from eol_ros.ros import network
network.configure('local')
import rclpy
rclpy.init()
rclpy.create_node('one')
print('up', flush=True)
"""


def port(folder, name, content=b'', age_s=10.0):
    path = folder / name
    path.write_bytes(content)
    return path, time.time() + age_s


def test_a_port_without_a_size_is_removed(tmp_path):
    path, now_s = port(tmp_path, 'fastrtps_port7411')
    assert shared_memory.release_unfinished(tmp_path, now_s) == ['fastrtps_port7411']
    assert not path.exists()


@pytest.mark.parametrize(
    'name, content, age_s',
    [
        ('fastrtps_port7411', b'x', 10.0),
        ('fastrtps_port7411', b'', 0.1),
        ('fastrtps_port7411_el', b'', 10.0),
        ('fastrtps_a7c60ff415db09f5_el', b'', 10.0),
        ('sem.fastrtps_port7411_mutex', b'', 10.0),
        ('other', b'', 10.0),
    ],
)
def test_all_else_stays(tmp_path, name, content, age_s):
    path, now_s = port(tmp_path, name, content, age_s)
    assert shared_memory.release_unfinished(tmp_path, now_s) == []
    assert path.read_bytes() == content


def test_a_folder_that_is_not_there_is_no_trouble(tmp_path):
    assert shared_memory.release_unfinished(tmp_path / 'none') == []


@pytest.mark.skipif(not os.access(shared_memory.FOLDER, os.W_OK), reason='no /dev/shm here')
def test_who_waits_for_a_half_made_port_goes_on_when_it_is_removed():
    domain = next_domain()
    # DDSI-RTPS 9.6.1.1: the port of the messages of a domain's first participant
    path = shared_memory.FOLDER / f'fastrtps_port{7400 + 250 * domain + 11}'
    path.touch()
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
    words = [sys.executable, '-c', PARTICIPANT]
    with subprocess.Popen(words, env=environment, stdout=subprocess.PIPE) as process:
        try:
            opened = f'/proc/{process.pid}/fd'

            def waits():
                with contextlib.suppress(OSError):  # one that is closed meanwhile
                    return str(path) in [os.readlink(f'{opened}/{fd}') for fd in os.listdir(opened)]
                return False

            wait_until(waits)
            with contextlib.suppress(FileNotFoundError):  # a supervisor of another test was first
                for _ in range(15):
                    os.utime(path)  # one that looks releases what is a second old
                    time.sleep(0.1)
                    assert process.poll() is None or path.stat().st_size
            while not select.select([process.stdout], [], [], 0.1)[0]:
                shared_memory.release_unfinished()
            assert process.stdout.readline() == b'up\n'
        finally:
            process.kill()
            path.unlink(missing_ok=True)


READER = """
from eol_ros.ros import network
network.configure('local')
import rclpy
from std_msgs.msg import Header
rclpy.init()
node = rclpy.create_node('reader')
node.create_subscription(Header, 'x', lambda _: print('got', flush=True), 10)
print('up', flush=True)
rclpy.spin(node)
"""
WRITER = """
from eol_ros.ros import network
network.configure('local')
import time
import rclpy
from std_msgs.msg import Header
rclpy.init()
publisher = rclpy.create_node('writer').create_publisher(Header, 'x', 10)
while True:
    publisher.publish(Header())
    time.sleep(0.01)
"""


@pytest.fixture
def python():
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(next_domain())}
    with contextlib.ExitStack() as stack:

        def run(text):
            process = subprocess.Popen(
                [sys.executable, '-c', text], env=environment, stdout=subprocess.PIPE, text=True
            )
            stack.callback(process.wait)
            stack.callback(process.kill)
            stack.callback(process.stdout.close)
            return process

        yield run


def in_order(port):
    """Whether Fast DDS takes a port that is open for one; the only bits of that word are 7."""
    port.seek(0)
    word = port.read()[276 + 24 :][:4]
    assert word in (b'\x06\0\0\0', b'\x07\0\0\0')
    return word == b'\x07\0\0\0'


def heard(process):
    return process.stdout.readline() == 'got\n'


@pytest.mark.parametrize(
    ('stopped', 'seen'), [(False, True), (True, True), (False, False)],
    ids=['killed', 'stopped and killed', 'killed with its bringup'],
)  # fmt: skip
def test_a_writer_finds_the_next_reader_once_the_port_of_a_killed_one_is_marked(
    python, stopped, seen
):
    python(WRITER)
    reader = python(READER)
    assert reader.stdout.readline() == 'up\n'
    assert heard(reader)
    ports = shared_memory.Ports()
    ports.look(reader.pid)
    numbers = shared_memory._read_by(reader.pid, shared_memory.FOLDER)
    assert len(numbers) == 2
    with contextlib.ExitStack() as stack:
        files = [
            stack.enter_context((shared_memory.FOLDER / f'fastrtps_port{k}').open('rb'))
            for k in numbers
        ]
        assert all(map(in_order, files))
        if stopped:
            reader.send_signal(signal.SIGSTOP)
        reader.kill()
        reader.wait()
        # DDS itself may have noticed by now
        assert not seen or set(ports.end()) <= set(numbers)
        if not seen:
            shared_memory.clean()
        assert not any(map(in_order, files))
    following = python(READER)
    assert following.stdout.readline() == 'up\n'
    assert heard(following)


def test_a_port_that_another_process_reads_is_left_alone(python):
    reader = python(READER)
    assert reader.stdout.readline() == 'up\n'
    ports = shared_memory.Ports()
    ports.look(reader.pid)
    assert ports.end() == []


def test_a_file_that_is_no_port_as_we_know_it_stays_as_it_is(tmp_path, monkeypatch):
    path, _ = port(tmp_path, 'fastrtps_port7411', bytes(4096))
    monkeypatch.setattr(shared_memory, '_read_by', lambda pid, folder: [7411])
    ports = shared_memory.Ports(tmp_path)
    ports.look(os.getpid())
    assert ports.end() == []
    assert path.read_bytes() == bytes(4096)
