# SPDX-License-Identifier: Apache-2.0
"""The supervisor over real processes that speak the heartbeat and misbehave in every known way."""

import contextlib
import itertools
import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.attended import attended
from support.waiting import GENEROUS_S, wait_until
from support.work_states import STATES

from eol_ros.bringup import child, policy, priority, status
from eol_ros.bringup.event_log import EventLog
from eol_ros.bringup.plan import Process
from eol_ros.bringup.supervisor import Around, Supervisor
from eol_ros.errors import UsageError
from eol_ros.said import said
from eol_ros.streams.work_state import DOWN, work_state

BEAT = """
import json, os, signal, sys, time
fd = int(os.environ['EOL_HEALTH_FD'])
def beat(name, level=0, rate=60.0):
    os.write(fd, (json.dumps({'node': name, 'level': level, 'text': 'fine', 'rate': rate,
                              'values': {}, 'pid': os.getpid()}) + chr(10)).encode())
signal.signal(signal.SIGINT, lambda *_: (print('bye', flush=True), sys.exit(0)))
signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
"""
STEADY = (
    BEAT
    + """
while True:
    beat(sys.argv[1]); time.sleep(0.1)
"""
)
STUBBORN = (
    BEAT
    + """
signal.signal(signal.SIGINT, signal.SIG_IGN); signal.signal(signal.SIGTERM, signal.SIG_IGN)
while True:
    beat(sys.argv[1]); time.sleep(0.1)
"""
)
FINAL = 'import sys; print("tracker: no such file"); sys.exit(78)'


class Clock:
    """Steady time, `rate` times as fast; `skip_s` more of it may pass."""

    def __init__(self, rate=1.0):
        self.rate, self.began_s, self.skip_s = rate, time.monotonic(), 0.0

    def __call__(self):
        return self.began_s + self.rate * (time.monotonic() - self.began_s) + self.skip_s


def process(name, script):
    return Process((name,), (sys.executable, '-c', script, name), {})


def all_ok(supervisor):
    wait_until(lambda: supervisor.all_ok_s is not None)


def restarted(child):
    wait_until(lambda: child.policy.restarts >= 1)


@pytest.fixture
def start(tmp_path):
    """A supervisor over the given processes, and the lines it says."""
    domains = itertools.count(1000 + os.getpid() * 10)
    with contextlib.ExitStack() as stack:

        def go(*processes, clock=time.monotonic, **around):
            server = stack.enter_context(status.listen(next(domains)))
            events = stack.enter_context(EventLog(tmp_path))
            lines = []
            supervisor = Supervisor(
                'test', processes, server, events, lines.append, Around(**around), clock
            )
            return supervisor, lines

        yield go


def test_all_ok_then_a_clean_stop(start):
    supervisor, lines = start(process('twin', STEADY), process('recorder', STEADY))

    code = supervisor.run(seconds=0.3)

    assert code == 0
    assert supervisor.all_ok_s is not None
    assert any(line.startswith('all OK after') for line in lines)
    byes = [line.split()[0] for line in lines if line.endswith('| bye')]
    assert byes == ['twin', 'recorder']  # the recorder goes last


def test_the_events_have_each_state_of_the_work_once(start, tmp_path, monkeypatch):
    supervisor, _ = start()
    supervisor.all_ok_s = 0.0
    for rows, _, _ in STATES.values():
        told = {'work': status.of_work(work_state(rows))}
        monkeypatch.setattr(supervisor, 'describe', lambda told=told: told)
        for _ in range(2):
            assert supervisor._step(0.0) is None
    lines = (tmp_path / 'events.log').read_text().splitlines()
    words = [line.partition('  test: ')[2] for line in lines]
    assert words == [english for _, english, _ in STATES.values()]


def test_who_may_wait_steps_back_when_all_is_up(start):
    polite = Process(('recorder',), (sys.executable, '-c', STEADY, 'recorder'), {}, nice=7)
    ours = os.getpriority(os.PRIO_PROCESS, 0)
    back = min(ours + 7, 19)
    supervisor, _ = start(polite, process('tracker', STEADY))

    def look():
        all_ok(supervisor)
        pids = [child.popen.pid for child in supervisor.children]
        wait_until(lambda: os.getpriority(os.PRIO_PROCESS, pids[0]) == back)
        groups = [Path(f'/proc/{pid}/autogroup') for pid in pids]
        if groups[0].exists():
            wait_until(lambda: groups[0].read_text().split()[-1] == str(back))
        assert os.getpriority(os.PRIO_PROCESS, pids[1]) == ours
        os.kill(pids[0], signal.SIGKILL)  # and so does the one that comes after it
        wait_until(
            lambda: supervisor.children[0].popen and supervisor.children[0].popen.pid != pids[0]
        )
        wait_until(
            lambda: os.getpriority(os.PRIO_PROCESS, supervisor.children[0].popen.pid) == back
        )

    attended(supervisor, look)


def allowed():
    """Whether this machine gives real-time priority to any user."""
    child = subprocess.Popen([sys.executable, '-c', 'input()'], stdin=subprocess.PIPE)
    try:
        os.sched_setscheduler(child.pid, os.SCHED_RR, os.sched_param(1))
        return True
    except PermissionError:
        return False
    finally:
        child.communicate(b'\n')


THREADED = (
    BEAT
    + """
import threading
from eol_ros.devices.carrier_thread import carrier_thread
threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
carrier_thread('camera', lambda: time.sleep(60)).start()
while not os.path.exists(sys.argv[2]):
    beat(sys.argv[1]); time.sleep(0.1)
carrier_thread('later', lambda: time.sleep(60)).start()
while True:
    beat(sys.argv[1]); time.sleep(0.1)
"""
)


def policies(pid):
    """Return the scheduling of each thread of ours, by the kernel's name for it."""
    found = {}
    for task in Path(f'/proc/{pid}/task').iterdir():
        name = 'main' if int(task.name) == pid else (task / 'comm').read_text().strip()
        found[name] = os.sched_getscheduler(int(task.name)) & ~os.SCHED_RESET_ON_FORK
        if found[name] == os.SCHED_RR:
            assert os.sched_getparam(int(task.name)).sched_priority == 2
    return found


@pytest.mark.parametrize(('may', 'given'), [(2, 2), (1, 1), (0, None)])
def test_a_limit_of_before_gives_the_lower_priority(monkeypatch, may, given):
    taken = set()

    def set_scheduler(thread, policy, parameter):
        if parameter.sched_priority > may:
            raise PermissionError
        taken.add(parameter.sched_priority)

    monkeypatch.setattr(os, 'sched_setscheduler', set_scheduler)
    assert priority.step_ahead(os.getpid(), 2) == (given is not None)
    assert taken == ({given} if given else set())


def test_the_kernel_ends_a_process_that_runs_on_with_real_time_priority(monkeypatch):
    monkeypatch.setattr(priority, 'SILENT_S', 0.2)
    code = 'print(flush=True); input()\nwhile True: pass'
    words = [sys.executable, '-c', code]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        try:
            assert child.stdout.readline()
            may = priority.step_ahead(child.pid, 1)
            limit = resource.prlimit(child.pid, resource.RLIMIT_RTTIME)
            if may:
                child.stdin.write(b'\n')
                child.stdin.flush()
                assert child.wait(GENEROUS_S) == -signal.SIGXCPU
        finally:
            child.kill()
    assert limit == (200_000, 1_200_000)


def test_what_carries_messages_goes_ahead(start, tmp_path):
    begin = tmp_path / 'begin'
    words = (sys.executable, '-c', THREADED, 'tracker', str(begin))
    first = Process(('tracker',), words, {}, real_time=2)
    supervisor, lines = start(first, process('montage', STEADY))
    ahead = os.SCHED_RR if (may := allowed()) else os.SCHED_OTHER
    seen = []

    def work():
        wait_until(lambda: all(child.settled for child in supervisor.children))
        pids = [child.popen.pid for child in supervisor.children]
        begin.touch()
        wait_until(lambda: policies(pids[0]).get('eol.later') == ahead)
        seen.append(policies(pids[0]))
        seen.append(os.sched_getscheduler(pids[1]))

    attended(supervisor, work)
    threads, montage = seen
    carrying = {name: threads.pop(name) for name in ('main', 'eol.camera', 'eol.later')}
    assert set(carrying.values()) == {ahead}
    # what else runs in there is no hurry
    assert len(threads) == 1 and set(threads.values()) == {montage} == {os.SCHED_OTHER}
    assert supervisor.describe()['real_time'] == may
    assert any('no real-time priority' in line for line in lines) == (not may)


def test_where_real_time_is_forbidden_it_is_said_once(start, monkeypatch):
    def forbid(*_):
        raise PermissionError

    monkeypatch.setattr(os, 'sched_setscheduler', forbid)
    processes = [
        Process((name,), (sys.executable, '-c', STEADY, name), {}, real_time=True)
        for name in ('tracker', 'motion')
    ]
    supervisor, lines = start(*processes)

    assert supervisor.run(seconds=0.5) == 0

    assert len([line for line in lines if 'no real-time priority' in line]) == 1
    assert supervisor.describe()['real_time'] is False


DEAF = STEADY.replace('beat(sys.argv[1])', 'beat(sys.argv[1], 0, 0.0)')
TROUBLED = STEADY.replace('beat(sys.argv[1])', 'beat(sys.argv[1], 1)')


def test_a_node_that_gets_nothing_of_what_is_given_is_started_again_alone(start, monkeypatch):
    monkeypatch.setattr(policy, 'UNFED_S', 0.4)
    supervisor, lines = start(process('twin', STEADY), process('tracker', DEAF))
    attended(supervisor, lambda: restarted(supervisor.children[1]))
    assert supervisor.children[0].policy.restarts == 0
    told = 'tracker gets nothing of the 60 a second that twin gives: it is started again'
    assert told in lines
    assert 'tracker has died (killed by SIGKILL); starting again' in lines


def test_what_a_stopped_node_said_it_gives_holds_no_longer(start, monkeypatch):
    """Else who gets nothing of a node that stands still is started again in its place."""
    monkeypatch.setattr(policy, 'UNFED_S', 0.8)
    monkeypatch.setattr(policy, 'STOPPED_S', 3.0)
    monkeypatch.setattr(child, 'QUIET_S', 0.4)
    deaf_later = DEAF.replace('while True:', 'beat(sys.argv[1]); time.sleep(1.0)\nwhile True:')
    supervisor, _ = start(process('twin', STEADY), process('tracker', deaf_later))
    twin, tracker = supervisor.children

    def work():
        all_ok(supervisor)
        os.kill(twin.popen.pid, signal.SIGSTOP)
        wait_until(lambda: twin.policy.silence.silent_s > 2.0)

    attended(supervisor, work)
    assert tracker.policy.restarts == 0


def test_a_stopped_process_never_goes_on(start, monkeypatch, tmp_path):
    """It would for an instant, and leave half done what its threads begin in it."""
    for name, value in (('SILENT_S', 10.0), ('STOPPED_S', 3.0), ('QUIET_S', 0.2), ('LOOK_S', 0.1)):
        monkeypatch.setattr(policy, name, value)
    stopped, went_on = tmp_path / 'stopped', tmp_path / 'went_on'
    stopped.touch()
    script = (
        BEAT
        + f"""
import threading
signal.signal(signal.SIGABRT, signal.SIG_IGN)
def note():
    while open({str(stopped)!r}).read() != str(os.getpid()):
        time.sleep(0.001)
    open({str(went_on)!r}, 'w').close()
threading.Thread(target=note, daemon=True).start()
while True:
    beat(sys.argv[1]); time.sleep(0.1)
"""
    )
    supervisor, lines = start(process('twin', script))

    def work():
        all_ok(supervisor)
        pid = supervisor.children[0].popen.pid
        os.kill(pid, signal.SIGSTOP)
        threads = list(Path(f'/proc/{pid}/task').iterdir())
        wait_until(lambda: all(') T' in (one / 'stat').read_text() for one in threads))
        stopped.write_text(str(pid))
        assert supervisor.children[0].popen.pid == pid  # else nothing was watched
        restarted(supervisor.children[0])

    attended(supervisor, work)
    assert not went_on.exists()
    assert 'twin was stopped: it is started again' in lines


def test_nobody_is_to_blame_where_a_camera_is_not_well_or_a_replay_stands(start, monkeypatch):
    monkeypatch.setattr(policy, 'UNFED_S', 0.2)
    others = (process('camera', TROUBLED), process('replay', STEADY), process('tracker', DEAF))
    supervisor, _ = start(*others)

    def beats():
        return [child.policy.beat_s for child in supervisor.children]

    def work():
        wait_until(lambda: all(beats()))
        first = max(beats())
        wait_until(lambda: min(beats()) > first + 1.0)

    attended(supervisor, work)
    assert [child.policy.restarts for child in supervisor.children] == [0, 0, 0]


KEEPING = (
    BEAT
    + """
had = json.loads(os.environ['EOL_KEPT']).get(sys.argv[1], {}), os.environ.get('EOL_AGAIN', '')
while True:
    os.write(fd, (json.dumps({'node': sys.argv[1], 'level': 0, 'text': json.dumps(had),
                              'values': {}, 'kept': {'asleep': True}}) + chr(10)).encode())
    time.sleep(0.1)
"""
)


def test_all_are_started_again_where_the_network_asks_for_it(start):
    """At once, or only when one of them is started again anyway; nobody counts as failed."""
    why, asked, after = [], [], []

    def changed(restarting):
        asked.append(restarting)
        return why.pop() if why else ''

    supervisor, lines = start(process('twin', STEADY), process('tracker', STEADY), changed=changed)

    def pids():
        running = [child.popen.pid for child in supervisor.children if child.well()]
        return running if len(running) == 2 else []

    def work():
        all_ok(supervisor)
        before = pids()
        why.append('the tunnel is up')
        after.extend(wait_until(lambda: not set(before) & set(found := pids()) and found))
        assert 'the tunnel is up: all nodes are started again' in lines
        assert True not in asked
        os.kill(after[1], signal.SIGKILL)
        wait_until(lambda: True in asked)
        after.extend(wait_until(pids))

    attended(supervisor, work)
    assert after[2] == after[0] and after[3] != after[1]  # nothing has changed: one comes back
    assert lines[-1].endswith(' 1 restarts')


@pytest.mark.parametrize(('what', 'code', 'starts'), [('restart', 0, 2), ('stop', 3, 1)])
def test_a_node_asks_for_all_to_be_started_again_or_to_end(start, tmp_path, what, code, starts):
    marks = tmp_path / 'marks'
    order = f"""
first = not os.path.exists({str(marks)!r})
open({str(marks)!r}, 'a').write('x')
beat('machine'); time.sleep(0.5)
while True:
    beat('machine'); time.sleep(0.1)
    if first:
        os.write(fd, (json.dumps(dict(order={what!r})) + chr(10)).encode())
"""
    supervisor, lines = start(process('twin', STEADY), process('machine', BEAT + order))

    def work():
        wait_until(lambda: marks.exists() and len(marks.read_text()) == starts)
        if what == 'restart':
            wait_until(lambda: all(child.well() for child in supervisor.children))
        else:
            wait_until(lambda: supervisor._asked_to_stop)

    assert attended(supervisor, work) == code
    assert sum('the service' in line for line in lines) == 1
    assert sum(line == 'twin | bye' for line in lines) == starts
    assert not any(child.policy.restarts for child in supervisor.children)


def test_a_killed_process_comes_back_alone_with_what_it_kept(start):
    """It is told that the others run."""
    supervisor, lines = start(process('twin', STEADY), process('tracker', KEEPING))
    twin, tracker = supervisor.children

    def text():
        return tracker.status.get('tracker', {}).get('text')

    def work():
        wait_until(lambda: text() == '[{}, ""]' and twin.settled)
        before = twin.popen.pid
        os.kill(tracker.popen.pid, signal.SIGKILL)
        wait_until(lambda: text() == '[{"asleep": true}, "1"]')
        assert (twin.popen.pid, tracker.policy.restarts) == (before, 1)

    attended(supervisor, work)
    assert 'tracker has died (killed by SIGKILL); trying again in 1 s' in lines


# `last` goes behind all others on one processor; its session's group too, where there is one.
LAST = (
    BEAT
    + """
def last():
    os.sched_setaffinity(0, [int(sys.argv[2])])
    os.nice(10)
    try:
        open('/proc/self/autogroup', 'w').write('10')
    except OSError:
        pass
def work(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass
"""
)
WORKING = (
    LAST
    + """
last()
while True:
    beat(sys.argv[1]); work(0.2)
"""
)
SLOW_TO_END = (
    LAST
    + """
signal.signal(signal.SIGINT, lambda *_: (last(), work(0.06), print('bye', flush=True), sys.exit(0)))
while True:
    beat(sys.argv[1]); time.sleep(0.1)
"""
)


@pytest.fixture
def hogs():
    """Start busy processes that leave next to nothing of one processor; return its number."""
    started = []

    def go():
        busy = [sys.executable, '-c', 'while True: pass']
        for _ in range(3):
            started.append(subprocess.Popen(busy, start_new_session=True))
            os.sched_setaffinity(started[-1].pid, [processor])

    def end():
        while started:
            hog = started.pop()
            hog.kill()
            hog.wait()

    go.processor = processor = max(os.sched_getaffinity(0))
    go.end = end
    yield go
    end()


def last(name, script, hogs):
    return Process((name,), (sys.executable, '-c', script, name, str(hogs.processor)), {})


def test_a_starved_process_is_reported_and_left_alone(start, hogs, monkeypatch):
    for name, value in (('SILENT_S', 2.0), ('QUIET_S', 0.2), ('LOOK_S', 0.1)):
        monkeypatch.setattr(policy, name, value)
    supervisor, lines = start(last('recorder', WORKING, hogs))
    child = supervisor.children[0]
    rows = []

    def work():
        all_ok(supervisor)
        pid = child.popen.pid
        hogs()
        wait_until(lambda: rows.append(dict(child.status['recorder'])) or rows[-1]['level'] == 1)
        hogs.end()
        wait_until(lambda: child.status['recorder']['level'] == 0)
        assert child.popen.pid == pid

    attended(supervisor, work)
    assert rows[-1]['text'].startswith('starved: waited ')
    assert sum('starved: waited' in line for line in lines) >= 1
    assert supervisor.describe()['restarts'] == 0
    assert not any('silent' in line for line in lines)


def test_a_slow_start_is_said_once_and_calmly(start):
    """Three processes wait for a processor; a disk later, when all were well, is told of each."""
    supervisor, lines = start(*(process(name, STEADY) for name in ('twin', 'tracker', 'sound')))
    for one in supervisor.children:
        one.status = {n: status.starting(n, said('starting')) for n in one.process.nodes}
        one.silence = policy.Silence(0.0, looked_s=6.0, processor_s=5.0)
        supervisor._leave(one)
        supervisor._leave(one)
    assert lines == ['slow start: processor busy']
    supervisor.all_ok_s = 9.0
    one.silence = policy.Silence(0.0, looked_s=6.0, disk_s=5.0)
    one.status['sound']['text'] = one.silence.words()
    supervisor._leave(one)
    supervisor._leave(one)
    assert lines[1:] == [
        'sound     starved: waited 5.0 of the last 6.0 s for a disk; left alone for up to 600 s'
    ]


def test_a_starved_process_is_given_the_time_to_end(start, hogs, monkeypatch):
    from eol_ros.bringup import supervisor as module

    steps = tuple((number, 0.5) for number, _ in module.STOP_STEPS)
    monkeypatch.setattr(module, 'STOP_STEPS', steps)
    monkeypatch.setattr(policy, 'LOOK_S', 0.1)
    supervisor, lines = start(last('recorder', SLOW_TO_END, hogs))

    def work():
        all_ok(supervisor)
        hogs()

    attended(supervisor, work)
    assert supervisor.children[0].code == 0
    assert any(line.endswith('| bye') for line in lines)


COMPILER = """
import json, os, sys, time
fd = int(os.environ['EOL_HEALTH_FD'])
for percent in (0, 40, 100):
    os.write(fd, json.dumps({'percent': percent}).encode() + bytes([10]))
    time.sleep(0.5)  # and not a word
sys.exit(int(sys.argv[1]))
"""


def compiler(code):
    return Process(('compiler',), (sys.executable, '-c', COMPILER, str(code)), {})


@pytest.mark.parametrize('code', [0, 1])
def test_the_compiler_comes_before_the_nodes_and_may_be_silent(start, code):
    clock = Clock()
    supervisor, lines = start(process('twin', STEADY), compiler=compiler(code), clock=clock)
    rows = []

    def look():
        rows.extend(supervisor.describe()['nodes'])
        if 'compiling, 40 %' in lines:
            clock.skip_s = 10 * policy.START_S
        return supervisor.all_ok_s

    def work():
        wait_until(look)

    attended(supervisor, work)
    before = [row for row in rows if row['text'].startswith('compiling')]
    assert {row['text'] for row in before} >= {'compiling, 0 %', 'compiling, 40 %'}
    assert {(row['node'], row['level'], row['pid']) for row in before} == {('twin', 3, 0)}
    assert 'compiling, 40 %' in lines
    assert any('compiling has failed (exit code 1)' in line for line in lines) == bool(code)
    assert supervisor.describe()['restarts'] == 0


def test_a_stop_while_it_compiles_starts_nothing(start):
    supervisor, lines = start(process('twin', STEADY), compiler=compiler(0))

    attended(supervisor, lambda: wait_until(lambda: 'compiling, 0 %' in lines))
    assert supervisor.children[0].code is None
    assert not any('failed' in line for line in lines)


@pytest.mark.parametrize('code', [2, 69, 78])
def test_what_cannot_start_ends_the_run_with_its_code(start, code):
    script = FINAL.replace('78', str(code))
    supervisor, lines = start(process('twin', STEADY), process('tracker', script))

    assert supervisor.run() == code
    assert 'tracker | tracker: no such file' in lines
    assert not any(child.alive() for child in supervisor.children)


def test_the_others_go_on_without_what_cannot_start(start, tmp_path):
    script = f'import os; os.path.exists({str(tmp_path / "card")!r}) or sys.exit(69);' + STEADY
    others = process('tracker', STEADY), process('montage', STEADY)
    supervisor, lines = start(*others, process('sound', 'import sys;' + script))

    def plug():
        all_ok(supervisor)
        assert supervisor.describe()['nodes'][-1]['level'] == DOWN
        (tmp_path / 'card').touch()
        wait_until(lambda: supervisor.children[-1].well())

    attended(supervisor, plug)
    told = [line for line in lines if 'cannot start' in line]
    assert told == [
        'sound cannot start (exit code 69): the others go on without it, and it is tried again'
    ]


def test_own_programs_are_restarted_and_never_end_the_run(start, tmp_path, monkeypatch):
    monkeypatch.setattr(policy, 'START_S', 20.0)
    marks = tmp_path / 'marks'
    failing = f"open({str(marks)!r}, 'a').write('x'); print('no table'); raise SystemExit(2)"
    quiet = "import os, time; open('here', 'w'); time.sleep(600)"
    (tmp_path / 'no_format').write_text('print(1)')
    (tmp_path / 'no_format').chmod(0o755)
    python = sys.executable
    programs = [
        Process((name,), command, {}, own=True, folder=tmp_path)
        for name, command in (
            ('quiet', (python, '-c', quiet)),
            ('once', (python, '-c', "print('counted')")),
            ('failing', (python, '-c', failing)),
            ('absent', ('./absent',)),
            ('odd', (str(tmp_path / 'no_format'),)),
            ('shell', ('sh', '-c', 'sleep 600 & echo $! > child; wait')),
            ('loud', (python, '-c', "print(*range(99_999), sep='\\n'); raise SystemExit(1)")),
            ('flood', ('yes',)),
            ('binary', ('printf', r'\033[2J\000\377\n')),
            ('nul', ('echo', 'a\0b')),
        )
    ]
    # as fast as silence is counted: half a second from look to look
    supervisor, lines = start(process('twin', STEADY), *programs, clock=Clock(rate=5.0))

    def work():
        all_ok(supervisor)
        wait_until(lambda: marks.exists() and len(marks.read_text()) > 2)
        began_s = supervisor._clock()
        wait_until(lambda: supervisor._clock() > began_s + 1.5 * policy.START_S)
        rows = {row['node']: row for row in supervisor.describe()['nodes']}
        assert (rows['quiet']['level'], rows['quiet']['text']) == (0, 'runs')
        assert rows['once']['text'] == 'finished'
        assert supervisor.children[1].policy.restarts == 0
        flood = next(c for c in supervisor.children if c.process.name == 'flood')
        assert flood.alive() and flood.policy.restarts == 0  # it waits while its output is not read

    attended(supervisor, work)
    assert (tmp_path / 'here').exists()
    child = Path('/proc', (tmp_path / 'child').read_text().strip())
    wait_until(lambda: not child.exists())
    assert 'absent | cannot start ./absent: No such file or directory' in lines
    assert any(line.startswith('odd | cannot start') for line in lines)
    loud = [line for line in lines if line.startswith('loud | ')]
    assert 'loud | 49' in loud and any('lines left out' in line for line in loud)
    assert 'binary | \\x1b[2J\\x00\ufffd' in lines
    assert any(line.startswith('nul | cannot start echo: ') for line in lines)
    assert {'once | counted', 'failing | no table', 'once has finished'} <= set(lines)
    assert any(line.startswith('failing has died (exit code 2)') for line in lines)


def test_an_own_program_that_fails_keeps_no_node_from_being_settled(start):
    supervisor, _ = start(process('twin', STEADY), Process(('mine',), ('false',), {}, own=True))
    for one, level in zip(supervisor.children, (0, DOWN), strict=True):
        name = one.process.name
        one.start_at_s = None
        one.status = {name: status.starting(name, said('starting')) | {'level': level}}
    assert supervisor._step(0.0) is None
    assert supervisor.all_ok_s is not None


def test_a_run_without_a_node_ends_with_the_code_of_that_node(start):
    others = process('tracker', STEADY), process('montage', STEADY)
    supervisor, _ = start(*others, process('sound', FINAL))

    assert supervisor.run(seconds=0.3) == 78


def test_nothing_is_left_if_only_a_source_runs(start):
    supervisor, lines = start(
        process('twin', STEADY), process('sound', FINAL), process('montage', FINAL)
    )

    assert supervisor.run() == 78
    assert sum('cannot start' in line for line in lines) == 2


def test_a_source_that_ends_ends_the_run(start):
    script = BEAT + "beat('replay'); time.sleep(0.3)"
    supervisor, lines = start(process('replay', script), process('tracker', STEADY))

    assert supervisor.run() == 0
    assert 'replay has finished' in lines


def test_a_stubborn_process_is_killed_in_the_end(start, monkeypatch):
    from eol_ros.bringup import supervisor as module

    steps = tuple((number, 0.3) for number, _ in module.STOP_STEPS)
    monkeypatch.setattr(module, 'STOP_STEPS', steps)
    supervisor, _ = start(process('twin', STUBBORN))

    assert supervisor.run(seconds=0.1) == 0
    assert supervisor.children[0].code == -signal.SIGKILL


def test_garbage_on_the_pipe_is_no_heartbeat(start):
    garbage = "os.write(fd, b'\\xff\\x00{]\\n[]\\n{}\\n'); beat('twin')"
    script = BEAT + garbage + '\nwhile 1: time.sleep(.1)'
    supervisor, _ = start(process('twin', script))

    assert supervisor.run(seconds=0.1) == 0


def test_no_orphan_when_bringup_is_killed(tmp_path):
    script = tmp_path / 'parent.py'
    script.write_text(f"""
import sys, time
from eol_ros.bringup.child import Child
from eol_ros.bringup.plan import Process
child = Child(Process(('twin',), (sys.executable, '-c', {STEADY!r}, 'twin'), {{}}))
child.start(0.0)
print(child.popen.pid, flush=True)
time.sleep(60)
""")
    parent = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True)
    pid = int(parent.stdout.readline())
    time.sleep(0.5)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    parent.stdout.close()

    def gone():
        try:
            with open(f'/proc/{pid}/stat') as stat:
                return stat.read().rsplit(')', 1)[1].split()[0] == 'Z'  # a zombie only looks alive
        except FileNotFoundError:
            return True

    wait_until(gone)


def test_status_over_the_socket_and_one_graph_per_domain(start):
    supervisor, _ = start(process('twin', STEADY))
    domain = 1000 + os.getpid() * 10
    answers = []

    def work():
        all_ok(supervisor)
        answers.append(status.ask(domain))
        with pytest.raises(UsageError, match='a graph runs on domain .* .scene test'):
            status.listen(domain)

    attended(supervisor, work)
    assert [(row['node'], row['level']) for row in answers[0]['nodes']] == [('twin', 0)]
    assert 'twin' in status.table(answers[0]) and '60.0 Hz' in status.table(answers[0])
    json.dumps(answers[0])


def test_a_fault_shows_its_last_line_and_keeps_the_rest_in_the_log(start, tmp_path):
    script = """
import sys
print('[WARN] [1.0] [twin]: thin', 'ice', 'twin: cracks', sep='\\n', file=sys.stderr)
raise RuntimeError("no ice\\nat all\\n\\nhere")
"""
    supervisor, lines = start(process('twin', script))

    attended(supervisor, lambda: restarted(supervisor.children[0]))
    shown = [line for line in lines if '|' in line]
    told = ['twin | twin: cracks', 'twin | RuntimeError: no ice']
    assert shown[:2] == told and set(shown) == set(told)
    log = (tmp_path / 'eol.log').read_text()
    assert all(line in log for line in ('Traceback (most recent call last)', 'at all', 'here'))


@pytest.mark.parametrize(('rate', 'start_s', 'least_s'), [(60, 4.0, 4), (0, 1e6, 5)])
def test_a_run_for_a_time_that_never_is_ok_fails(start, monkeypatch, rate, start_s, least_s):
    """After the longest start, or where a fault lasts: here a source without images."""
    from eol_ros.bringup import supervisor as module

    monkeypatch.setattr(module, 'START_S', start_s)
    monkeypatch.setattr(module, 'START_STARVED_S', 1e6)
    script = BEAT + f"\nwhile True:\n    beat('twin', 1, {rate}); time.sleep(0.1)"
    supervisor, lines = start(process('twin', script), clock=Clock(rate=4.0))

    assert supervisor.run(seconds=0.1) == 1
    [line] = [line for line in lines if line.startswith('not all OK within')]
    assert line.endswith(' s: twin (fine)') and int(line.split()[4]) >= least_s


def test_a_hung_process_says_where(start, monkeypatch, tmp_path):
    monkeypatch.setattr(policy, 'SILENT_S', 0.5)
    script = (
        'import faulthandler; faulthandler.enable()'
        + BEAT
        + """
def stuck_in_the_ice():
    time.sleep(100)
beat('twin'); stuck_in_the_ice()
"""
    )
    supervisor, lines = start(process('twin', script))

    attended(supervisor, lambda: restarted(supervisor.children[0]))
    assert 'twin is silent: it is started again' in lines
    assert 'stuck_in_the_ice' in (tmp_path / 'eol.log').read_text()
    assert not any('stuck_in_the_ice' in line for line in lines)
