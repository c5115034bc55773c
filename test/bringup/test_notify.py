# SPDX-License-Identifier: Apache-2.0
"""Messages reach real servers on the loopback, and one that hangs delays nothing."""

import email
import email.policy
import http.server
import json
import os
import socket
import ssl
import threading
import time
from pathlib import Path

import pytest
from aiosmtpd.controller import Controller
from aiosmtpd.smtp import AuthResult
from support.waiting import wait_until

from eol_ros import cli
from eol_ros import scene as scenes
from eol_ros.bringup import notify
from eol_ros.bringup.notify import Mail, Message, NotDelivered, Notifier, Sender, Webhook
from eol_ros.errors import ConfigError
from eol_ros.said import code_and_args, said
from eol_ros.scene import SceneError
from eol_ros.settings import NotifySettings

NOON = 1_795_600_800.0  # 2026-11-25, 10:00 UTC


@pytest.fixture
def hook():
    """A web server that keeps what is posted; `codes` are what it answers, then 200."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self):
            body = self.rfile.read(int(self.headers['Content-Length']))
            server.got.append((self.path, self.headers['Content-Type'], json.loads(body)))
            code = server.codes.pop(0) if server.codes else 200
            self.send_response(code)
            if code == 302:
                self.send_header('Location', server.url)
            self.end_headers()

        def log_message(self, *_args):
            pass

    server = http.server.ThreadingHTTPServer(('127.0.0.1', 0), Handler)
    server.got, server.codes = [], []
    server.url = f'http://127.0.0.1:{server.server_port}/services/T0P'
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    yield server
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture
def deaf():
    """The address of a server that takes connections and never says a word."""
    with socket.create_server(('127.0.0.1', 0), backlog=50) as server:
        yield f'127.0.0.1:{server.getsockname()[1]}'


def free_port():
    with socket.create_server(('127.0.0.1', 0)) as server:
        return server.getsockname()[1]


class Mailbox:
    def __init__(self):
        self.mails, self.users = [], []

    async def handle_DATA(self, _server, _session, envelope):  # noqa: N802
        mail = email.message_from_bytes(envelope.content, policy=email.policy.default)
        self.mails.append((envelope.rcpt_tos, mail))
        return '250 OK'

    def __call__(self, _server, _session, _envelope, _mechanism, login):
        self.users.append((login.login, login.password))
        return AuthResult(success=login.password == b'right', handled=False)


@pytest.fixture
def mailbox():
    box = Mailbox()
    controller = Controller(box, hostname='127.0.0.1', port=free_port())
    controller.start()
    box.address = f'127.0.0.1:{controller.server.sockets[0].getsockname()[1]}'
    yield box
    controller.stop()


CERTIFICATE = Path(__file__).parents[1] / 'support' / 'localhost.pem'


@pytest.fixture
def strict_mailbox():
    """A mail server that wants STARTTLS and a password."""
    box, context = Mailbox(), ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(CERTIFICATE)
    controller = Controller(
        box, hostname='127.0.0.1', port=free_port(), tls_context=context, require_starttls=True,
        authenticator=box, auth_required=True,
    )  # fmt: skip
    controller.start()
    box.address = f'localhost:{controller.server.sockets[0].getsockname()[1]}'
    yield box
    controller.stop()


def by_mail(address, **more):
    values = {'mail_to': ('a@museum.at', 'b@museum.at'), 'mail_from': 'eol@museum.at'}
    return NotifySettings(**{**values, 'smtp': address, 'smtp_security': 'none', **more})


def test_a_webhook_gets_the_message_as_json(hook):
    way, message = Webhook(hook.url), Message('trouble', 'museum', '1 trouble', ('leds: WARN',))
    assert way.send(message) == 'HTTP 200'
    ((path, kind, body),) = hook.got
    assert (path, kind) == ('/services/T0P', 'application/json')
    assert body == dict(message) and body['kind'] == 'trouble' and body['lines'] == ['leds: WARN']
    assert body['text'] == f'{body["title"]}\n- leds: WARN'


@pytest.mark.parametrize('code', [302, 404, 500])
def test_a_webhook_that_does_not_take_it(hook, code):
    hook.codes.append(code)
    with pytest.raises(NotDelivered, match=f'^HTTP {code}$'):
        Webhook(hook.url).send(Message('test', 'museum', 'a test'))
    assert len(hook.got) == 1


def test_a_webhook_whose_certificate_nobody_vouches_for_gets_nothing(hook):
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(CERTIFICATE)
    hook.socket = context.wrap_socket(hook.socket, server_side=True)
    with pytest.raises(NotDelivered, match='CERTIFICATE_VERIFY_FAILED'):
        Webhook(hook.url.replace('http:', 'https:')).send(Message('test', 'museum', 'a test'))
    assert hook.got == []


def test_what_a_dead_or_deaf_server_says(deaf, monkeypatch):
    monkeypatch.setattr(notify, 'TIMEOUT_S', 0.1)
    message = Message('test', 'museum', 'a test')
    ways = [
        Webhook(f'http://{deaf}'),
        Mail(by_mail(deaf)),
        Mail(by_mail(deaf, smtp_security='tls')),
    ]
    for way in ways:
        with pytest.raises(NotDelivered, match='timed out'):
            way.send(message)
    with socket.create_server(('127.0.0.1', 0)) as server:
        gone = f'127.0.0.1:{server.getsockname()[1]}'
    for way in (Webhook(f'http://{gone}'), Mail(by_mail(gone))):
        with pytest.raises(NotDelivered, match='refused'):
            way.send(message)


def test_mail_says_in_the_subject_what_it_is_about(mailbox):
    told = Mail(by_mail(mailbox.address)).send(Message('day', 'museum', 'open 10.0 h', ('x: y',)))
    assert told == f'taken by {mailbox.address}'
    ((to, mail),) = mailbox.mails
    assert to == ['a@museum.at', 'b@museum.at'] and mail['From'] == 'eol@museum.at'
    assert mail['Subject'].startswith('museum on ') and mail['Subject'].endswith(': open 10.0 h')
    assert mail.get_content().splitlines()[1] == '- x: y' and mail['Auto-Submitted']


def test_mail_with_a_password_goes_through_tls_alone(strict_mailbox):
    context = ssl.create_default_context(cafile=CERTIFICATE)
    message = Message('test', 'museum', 'a test')
    options = {'smtp_security': 'starttls', 'smtp_user': 'eol', 'smtp_password': 'right'}
    Mail(by_mail(strict_mailbox.address, **options), context).send(message)
    assert len(strict_mailbox.mails) == 1 and strict_mailbox.users == [(b'eol', b'right')]
    with pytest.raises(NotDelivered, match='^535 '):
        wrong = {**options, 'smtp_password': 'wrong'}
        Mail(by_mail(strict_mailbox.address, **wrong), context).send(message)
    with pytest.raises(NotDelivered, match='CERTIFICATE_VERIFY_FAILED'):
        Mail(by_mail(strict_mailbox.address, **options)).send(message)
    with pytest.raises(NotDelivered, match='^530 '):
        Mail(by_mail(strict_mailbox.address), context).send(message)


def test_a_message_that_was_not_taken_is_sent_again(hook):
    hook.codes += [500, 503]
    sender = Sender(Webhook(hook.url), again_s=(0.01, 0.02))
    for text in ('one', 'two'):
        sender.put(Message('test', 'museum', text))
    wait_until(lambda: len(hook.got) == 4)
    titles = [body['title'].rpartition(': ')[2] for _, _, body in hook.got]
    assert titles == ['one', 'one', 'one', 'two']
    wait_until(lambda: not sender.trouble)
    sender.end()


def status(rows, restarts=0):
    values = {'values': {}, 'text': 'fine', 'code': '', 'args': {}}
    work = {'text': said('awake'), 'code': 'awake', 'args': {}}
    return {'nodes': [{**values, **row} for row in rows], 'restarts': restarts, 'work': work}


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """A function that reads a scene which tells by these ways."""
    monkeypatch.setenv('EOL_STATE', str(tmp_path / 'state'))
    monkeypatch.setenv('TZ', 'UTC')
    time.tzset()

    def load(*lines):
        path = tmp_path / 'museum.yaml'
        text = '\n'.join(f'  {line}' for line in lines)
        path.write_text(f'nodes: {{twin: {{}}, recorder: {{min_free_gb: 0}}}}\nnotify:\n{text}\n')
        return scenes.load(path)

    yield load
    monkeypatch.undo()
    time.tzset()


def test_a_run_tells_by_both_ways_though_one_hangs(scene, hook, deaf):
    settings = scene(f'webhook: {hook.url}', 'mail_to: [a@b.at]', 'mail_from: c@d.at',
                     f'smtp: {deaf}', 'smtp_security: none')  # fmt: skip
    notifier = Notifier(settings, wall=lambda: NOON)
    for second in range(4000):
        wrong = {'node': 'leds', 'level': 1, 'text': 'no board'}
        rows = [wrong] if second < 200 else [{'node': 'leds', 'level': 0}]
        notifier.look(float(second), status(rows), {'leds': 0})
    wait_until(lambda: len(hook.got) == 2)
    bodies = [body for _, _, body in hook.got]
    assert [body['kind'] for body in bodies] == ['trouble', 'well']
    assert bodies[0]['lines'] == ['leds: WARN, no board, for 60 s']
    assert bodies[1]['lines'] == ['leds: recovered']
    assert bodies[1]['work'] == 'awake' and '\n- awake\n' in bodies[1]['text']
    notifier.end()


def test_messages_are_in_the_language_that_the_scene_asks_for(scene, hook):
    settings = scene(f'webhook: {hook.url}', 'language: zh-Hant', 'after_s: 5', 'pause_s: 10')
    notifier = Notifier(settings, wall=lambda: NOON)
    why = said('lost', why=said('a_camera'))
    code, args = code_and_args(why)
    wrong = {'node': 'tracker', 'level': 2, 'text': why, 'code': code, 'args': args}
    found = [
        message
        for second in range(60)
        if (message := notifier.look(float(second), status([wrong] * (second < 20)), {}))
    ]
    notifier.end()
    assert [message['lines'] for message in found] == [
        ['tracker：故障，追蹤中斷：相機，已持續 5 秒'], ['tracker：已恢復'],
    ]  # fmt: skip
    assert found[1]['title'].endswith('上的 museum：所有故障皆已恢復')
    assert found[1]['work'] == '運作中'


def test_the_day_is_summed_up_over_restarts_and_a_night_without_power(scene, hook):
    loaded, now_s = scene(f'webhook: {hook.url}', "daily: '20:00'"), 0.0
    for hour in (0.0, 5.0):  # two runs of an hour: at 10:00 and at 15:00
        at_s = NOON + 3600 * hour
        notifier = Notifier(loaded, wall=lambda at_s=at_s: at_s)
        for now_s in range(0, 3601, 60):
            rows = [{'node': 'motion', 'level': 0, 'values': {'slips': 2 * now_s}}]
            assert notifier.look(float(now_s), status(rows, int(hour > 0)), {}) is None
        notifier.end()
    never = Notifier(loaded, wall=lambda: 100.0)  # the clock has lost its time: it is waited for
    assert never.look(0.0, status([]), {}) is None
    never.end()
    morning = Notifier(loaded, wall=lambda: NOON + 86_400.0)
    message = morning.look(0.0, status([]), {})
    day = ': 2026-11-25, open 2.0 h, restarts 1, slips 14 400, messages lost 0'
    assert message['title'].endswith(day)
    assert message['kind'] == 'day'
    assert morning.look(10.0, status([]), {}) is None
    morning.end()


def test_the_time_of_the_day_line_in_summer_and_winter(monkeypatch):
    monkeypatch.setenv('TZ', 'Europe/Vienna')
    time.tzset()
    try:
        for after, then in (('2026-03-28 20:00', '2026-03-29 20:00'),
                            ('2026-10-24 20:01', '2026-10-25 20:00'),
                            ('2026-12-31 19:59', '2026-12-31 20:00')):  # fmt: skip
            after_s, then_s = (
                time.mktime(time.strptime(text, '%Y-%m-%d %H:%M')) for text in (after, then)
            )
            assert notify.next_time(after_s, 20 * 60) == then_s
    finally:
        monkeypatch.undo()
        time.tzset()


def test_a_disk_that_is_nearly_full_is_told(scene, hook):
    loaded = scene(f'webhook: {hook.url}')
    recorder = loaded.nodes['recorder']
    loaded.nodes['recorder'] = type(recorder)(min_free_gb=1e6)
    notifier = Notifier(loaded, wall=lambda: NOON)
    wait_until(lambda: notifier._free_bytes)
    assert notifier.look(0.0, status([]), {}) is None
    message = notifier.look(61.0, status([]), {})
    assert 'GB free; recording stops at 1e+06 GB' in message['lines'][0]
    notifier.end()


@pytest.mark.parametrize(
    ('lines', 'what'),
    [
        (['after_s: 60'], 'notify.webhook: no receiver: give webhook or mail_to'),
        (['webhook: ftp://a/b'], 'notify.webhook: is not an address that begins with https://'),
        (['mail_to: [nobody]', 'mail_from: a@b.at', 'smtp: a:25'], "'nobody' is not a mail addr"),
        (['mail_to: [a@b.at]', 'smtp: a:25'], "notify.mail_from: '' is not a mail address"),
        (['mail_to: [a@b.at]', 'mail_from: a@b.at', 'smtp: a'], "'a' is not HOST:PORT"),
        (['webhook: http://a', "daily: '25:00'"], "notify.daily: '25:00' is not a time of day"),
        (['webhook: http://a', 'smtp_user: u', 'smtp_security: none'], 'password in clear'),
    ],
)
def test_settings_that_cannot_be_meant(scene, capsys, lines, what):
    loaded = scene(*lines)
    with pytest.raises(ConfigError, match='^[^\n]*$') as error:
        notify.check(loaded.notify)
    assert what in str(error.value)
    assert cli.main(['check', str(loaded.path)]) == 78
    words = capsys.readouterr().err
    assert what in words and 'museum.yaml:' in words and '1 error' in words


def test_a_key_that_does_not_exist_and_the_place_of_a_value(scene):
    with pytest.raises(SceneError, match=r'museum.yaml:3:3 error notify.webhok: no such key. Did'):
        scene('webhok: http://a')
    with pytest.raises(SceneError, match=r'museum.yaml:4:12 error notify.after_s: 1 is out of'):
        scene('webhook: http://a', 'after_s: 1')


def test_secrets_are_shown_to_nobody(scene, capsys):
    mail = ['mail_to: [a@b.at]', 'mail_from: a@b.at', 'smtp: mail.museum.at:587']
    secret = ['webhook: https://hooks.museum.at/T0P', 'smtp_user: eol', 'smtp_password: hunter2']
    loaded = scene(*mail, *secret)
    assert cli.main(['check', str(loaded.path), '--json']) == 0
    shown = capsys.readouterr().out + str(scenes.plain(scenes.public(loaded)))
    shown += scenes.public(loaded).text
    assert 'T0P' not in shown and 'hunter2' not in shown and '***' in shown
    assert 'hunter2' in str(scenes.plain(loaded))


def test_the_test_command_says_what_each_server_answered(scene, hook, mailbox, capsys):
    lines = [f'webhook: {hook.url}', 'mail_to: [a@b.at]', 'mail_from: c@d.at']
    loaded = scene(*lines, f'smtp: {mailbox.address}', 'smtp_security: none')
    assert cli.main(['notify', str(loaded.path)]) == 0
    assert capsys.readouterr().out == f'webhook: HTTP 200\nmail: taken by {mailbox.address}\n'
    assert hook.got[0][2]['kind'] == 'test' and len(mailbox.mails) == 1
    hook.codes.append(403)
    assert cli.main(['notify', str(loaded.path)]) == 1
    told = capsys.readouterr()
    assert (told.err, 'mail: taken' in told.out) == ('webhook: HTTP 403\n', True)
    path = loaded.path.with_name('quiet.yaml')
    path.write_text('nodes: {twin: {}}\n')
    assert cli.main(['notify', str(path)]) == 78
    assert 'no receiver of notifications; add notify' in capsys.readouterr().err


def test_the_supervisor_hands_its_state_over_and_says_what_was_told(scene, hook, tmp_path):
    from eol_ros.bringup import status as statuses
    from eol_ros.bringup.event_log import EventLog
    from eol_ros.bringup.plan import Process
    from eol_ros.bringup.supervisor import Around, Supervisor

    settings = scene(f'webhook: {hook.url}', 'after_s: 5', 'pause_s: 10')
    dies = 'import sys, time; time.sleep(0.2); sys.exit(1)'
    process = Process(('leds',), (os.sys.executable, '-c', dies), {})
    said, steady = [], time.monotonic
    with statuses.listen(4000 + os.getpid()) as server, EventLog(tmp_path) as events:
        supervisor = Supervisor(
            'museum', [process], server, events, said.append,
            Around(notifier=Notifier(settings, wall=lambda: NOON)), lambda: 20 * steady(),
        )  # fmt: skip
        runner = threading.Timer(0, lambda: (wait_until(lambda: hook.got), supervisor.stop()))
        runner.start()
        supervisor.run()
        runner.join()
    body = hook.got[0][2]
    assert body['kind'] == 'trouble' and body['lines'][0].startswith('leds: ')
    assert any(line.startswith('told: museum on ') for line in said)
