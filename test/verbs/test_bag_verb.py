# SPDX-License-Identifier: Apache-2.0
"""eol bag: proves, repairs and cuts; whatever it writes is whole."""

import json
import random
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from mcap.writer import Writer

from eol_ros import cli
from eol_ros.devices.bag import recover
from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.verify import verify
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.errors import BagDamaged, EolError

sys.path.insert(0, str(Path(__file__).parents[1] / 'devices'))

from support.bag_samples import POINT, T0, TEXT, point, text, write_bag

LATCHED = BagTopic('/eol/corpus', TEXT.type, TEXT.definition, TEXT.type_hash,
                   '- durability: transient_local\n')  # fmt: skip


def rows(path):
    return [(m.topic, m.log_ns, m.data) for m in BagReader(path).messages()]


def damaged(folder, cut=False):
    """Write a bag of which one chunk has a flipped bit, maybe without an end; return its rest."""
    bag = BagWriter(folder, [POINT], {'scene': 'x'})
    for i in range(40):
        bag.write('/eol/point', point(i), T0 + i * 10**8, T0, i + 1)
        if i % 10 == 9:
            bag.flush()
    bag.abandon() if cut else bag.close()
    [path] = folder.glob('*.mcap*')
    data = bytearray(path.read_bytes())
    place = BagReader(path).files[0].places[1]
    data[(place.offset + place.end) // 2] ^= 1
    path.write_bytes(data)
    return [*range(10), *range(20, 40)]


def test_what_holds_at_a_time_is_the_last_of_each_latched_topic(tmp_path):
    bag = BagWriter(tmp_path / 'run', [LATCHED, replace(LATCHED, name='/eol/wall'), TEXT], {})
    for i, (name, words) in enumerate(
        [('corpus', 'ice'), ('wall', 'a'), ('text', 'x'), ('wall', 'b'), ('corpus', 'snow')]
    ):
        bag.write(f'/eol/{name}', text(words), T0 + i * 100 * 10**9, T0, i)  # 100 s apart
    bag.close()
    reader = BagReader(tmp_path / 'run')

    def held(at_s, topics=None):
        found = reader.latched(topics, T0 + at_s * 10**9)
        return [(m.topic, m.data) for m in found]

    ice, snow = (('/eol/corpus', text(words)) for words in ('ice', 'snow'))
    a, b = (('/eol/wall', text(words)) for words in 'ab')
    assert held(0) == []
    assert held(1) == [ice]
    assert held(299) == [ice, a]
    assert held(301) == [ice, b]
    assert held(1000) == [b, snow]
    assert held(1000, ['/eol/corpus', '/eol/text']) == [snow]


def test_verify_tells_whole_from_damaged(tmp_path, capsys):
    write_bag(tmp_path / 'good').close()
    assert cli.main(['bag', 'verify', str(tmp_path / 'good')]) == 0
    assert 'good: whole, 110 messages' in capsys.readouterr().out
    damaged(tmp_path / 'bad')
    assert cli.main(['bag', 'verify', str(tmp_path / 'bad'), '--json']) == 1
    found = json.loads(capsys.readouterr().out)
    assert not found['whole']
    assert 'messages from 1.000 s to 1.900 s may be missing' in found['wrong'][0]


def test_info_is_for_people_and_programs(tmp_path, capsys):
    write_bag(tmp_path / 'run').close()
    assert cli.main(['bag', 'info', str(tmp_path / 'run')]) == 0
    assert '100  /eol/point' in capsys.readouterr().out
    assert cli.main(['bag', 'info', str(tmp_path), '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['topics']['/eol/text'] == {'type': 'std_msgs/msg/String', 'messages': 10}


def test_info_says_what_damage_has_cost_and_what_to_do(tmp_path, capsys):
    left = damaged(tmp_path / 'bad')
    assert cli.main(['bag', 'info', str(tmp_path / 'bad')]) == 1
    where, cost = capsys.readouterr().err.splitlines()
    assert 'messages from 1.000 s to 1.900 s may be missing' in where
    assert 'one place: 10 of 40 messages are lost, within 0.9 s; `eol bag recover' in cost
    assert cost.endswith('--output NEW` writes what is left as a new bag')
    words = cost[cost.index('`eol') + 5 : cost.rindex('`')].replace('NEW', str(tmp_path / 'new'))
    assert cli.main(words.split()) == 1 and len(rows(tmp_path / 'new')) == len(left)

    assert cli.main(['bag', 'info', str(tmp_path / 'bad'), '--json']) == 1
    found = json.loads(capsys.readouterr().out)
    assert found['unreadable'] == {'messages': 10, 'seconds': pytest.approx(0.9)}
    assert cli.main(['bag', 'info', str(tmp_path / 'bad'), '--index']) == 0  # which is right
    assert capsys.readouterr().err == ''


def test_info_tells_a_cut_bag_from_one_that_is_being_recorded(tmp_path, capsys):
    bag = write_bag(tmp_path / 'run')
    bag.flush()
    assert cli.main(['bag', 'info', str(tmp_path / 'run')]) == 0
    told = capsys.readouterr().err
    assert told.endswith('/run: is being recorded\n') and '.part has no end: ' in told
    bag.abandon()
    assert cli.main(['bag', 'info', str(tmp_path / 'run')]) == 0
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.endswith(f'`eol bag recover {tmp_path}/run` makes it whole')

    left = damaged(tmp_path / 'both', cut=True)
    assert cli.main(['bag', 'info', str(tmp_path / 'both')]) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert 'one place: an unknown number of messages are lost, within 0.9 s; ' in last
    assert last.endswith(f'`eol bag recover {tmp_path}/both` makes it whole without that')
    assert cli.main(['bag', 'recover', str(tmp_path / 'both')]) == 1
    assert len(rows(tmp_path / 'both')) == len(left)
    assert cli.main(['bag', 'verify', str(tmp_path / 'both')]) == 0


def test_recover_takes_a_file_that_lies_among_others_for_itself(tmp_path):
    bag = write_bag(tmp_path / 'run')
    bag.flush()
    before = rows(tmp_path / 'run')
    bag.abandon()
    [part] = (tmp_path / 'run').glob('*.mcap.part')
    folder = tmp_path / 'downloads'
    folder.mkdir()
    part.rename(folder / 'cut.mcap')
    (folder / 'other.mcap').touch()
    assert cli.main(['bag', 'recover', str(folder / 'cut.mcap')]) == 0
    assert rows(folder / 'cut.mcap') == before
    assert sorted(path.name for path in folder.iterdir()) == ['cut.mcap', 'other.mcap']


def test_recover_says_that_a_bag_is_whole_and_leaves_it_as_it_is(tmp_path, capsys):
    write_bag(tmp_path / 'run').close()
    metadata = tmp_path / 'run' / 'metadata.yaml'
    metadata.write_text('# ours\n' + metadata.read_text())
    before = {path: path.read_bytes() for path in (tmp_path / 'run').iterdir()}
    whole = f'{tmp_path}/run: whole, 110 messages: nothing is left to recover\n'

    assert cli.main(['bag', 'recover', str(tmp_path / 'run')]) == 0
    assert capsys.readouterr().err == whole
    assert {path: path.read_bytes() for path in (tmp_path / 'run').iterdir()} == before

    metadata.unlink()
    assert cli.main(['bag', 'recover', str(tmp_path / 'run')]) == 0
    assert capsys.readouterr().err == f'{metadata}: written again\n{whole}'
    assert metadata.exists()


def test_recover_leaves_a_bag_alone_that_is_being_recorded(tmp_path, capsys):
    bag = write_bag(tmp_path / 'run')
    bag.flush()
    out = tmp_path / 'so-far.mcap'

    assert cli.main(['bag', 'recover', str(tmp_path / 'run')]) == 2
    assert 'run_0.mcap.part: is being recorded; --output OUT' in capsys.readouterr().err
    assert cli.main(['bag', 'recover', str(tmp_path / 'run'), '--output', str(out)]) == 0
    assert len(rows(out)) == 110
    bag.close()


def test_recover_writes_what_can_be_read_of_a_damaged_bag(tmp_path, capsys):
    left = damaged(tmp_path / 'bad')
    assert cli.main(['bag', 'recover', str(tmp_path / 'bad')]) == 2
    assert '--output OUT' in capsys.readouterr().err
    out = tmp_path / 'left.mcap'
    assert cli.main(['bag', 'recover', str(tmp_path / 'bad'), '-o', str(out)]) == 1
    assert 'from 1.000 s to 1.900 s' in capsys.readouterr().err
    assert rows(out) == [('/eol/point', T0 + i * 10**8, point(i)) for i in left]
    assert cli.main(['bag', 'verify', str(out)]) == 0
    assert '1.000 s' in BagReader(out).gaps['damaged']


@pytest.mark.slow
def test_every_command_that_meets_damage_says_so(tmp_path):
    """Not the commands of `eol bag` alone: a table with a hole must not pass for a whole one."""
    left = damaged(tmp_path / 'bad')
    done = subprocess.run(
        [sys.executable, '-m', 'eol_ros', 'report', tmp_path / 'bad', '--csv', 'point',
         '--output', tmp_path / 'out'], capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 1
    assert 'from 1.000 s to 1.900 s may be missing' in done.stderr
    lines = (tmp_path / 'out' / 'point.csv').read_text().splitlines()
    assert len(lines) == 1 + len(left)


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (
            ['cut', 'bags/sample', '--start', '30', '--end', '10'],
            '30 --end 10: it ends before it begins',
        ),
        (['cut', 'bags/sample', '--start', '300'], '--start 300: the bag has 4'),
        (['cut', 'bags/sample', '--topics', ','], "',': names no topic"),
        (['cut', 'bags/sample', '--topics', ''], "'': names no topic"),
    ],
)
def test_what_cannot_be_meant_is_refused(tmp_path, capsys, words, said):
    assert cli.main(['bag', *words, '-o', str(tmp_path / 'out')]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize('out', ['cut', 'cut.mcap'])
def test_cut_keeps_a_stretch_and_what_holds_in_it(tmp_path, out):
    bag = BagWriter(tmp_path / 'run', [POINT, TEXT, LATCHED], {'scene': 'x'})
    bag.write('/eol/corpus', text('old'), T0, T0)
    bag.write('/eol/corpus', text('ice'), T0 + 1, T0)
    for i in range(100):
        bag.write('/eol/point', point(i), T0 + i * 10**9, T0, i + 1)
        bag.write('/eol/text', text('x'), T0 + i * 10**9, T0, i + 1)
    bag.close()
    words = ['bag', 'cut', str(tmp_path / 'run'), '--start', '20', '--end', '30']
    words += ['--topics', 'point,corpus', '--output', str(tmp_path / out)]
    assert cli.main(words) == 0
    corpus = ('/eol/corpus', T0 + 20 * 10**9, text('ice'))
    points = [('/eol/point', T0 + i * 10**9, point(i)) for i in range(20, 30)]
    assert sorted(rows(tmp_path / out)) == sorted([corpus, *points])
    assert BagReader(tmp_path / out).about['scene'] == 'x'
    assert cli.main(words) == 78  # it is there already
    assert cli.main([*words[:3], '--start', '200', '-o', str(tmp_path / 'no')]) == 2


def test_keep_marks_a_bag_and_takes_the_mark_away(tmp_path):
    write_bag(tmp_path / 'run').close()
    assert cli.main(['bag', 'keep', str(tmp_path / 'run')]) == 0
    assert (tmp_path / 'run' / 'kept.txt').exists()
    assert cli.main(['bag', 'verify', str(tmp_path / 'run')]) == 0
    assert cli.main(['bag', 'keep', str(tmp_path / 'run'), '--off']) == 0
    assert not (tmp_path / 'run' / 'kept.txt').exists()
    assert cli.main(['bag', 'keep', str(tmp_path / 'run' / 'run_0.mcap')]) == 2


def cut_at(folder, size):
    """Return the only file of a small bag, as it is when a killed machine kept `size` bytes."""
    writer = write_bag(folder)
    writer.flush()
    writer.abandon()
    [path] = folder.glob('*.mcap.part')
    data = path.read_bytes()
    path.write_bytes(data[: round(size * len(data))])
    return path


@pytest.mark.parametrize('k', range(0, 40, 3))
def test_recover_deletes_nothing_of_which_it_saves_nothing(tmp_path, capsys, k):
    path = cut_at(tmp_path / 'run', k / 40)
    before = path.read_bytes()
    code = cli.main(['bag', 'recover', str(tmp_path / 'run')])
    if whole := list((tmp_path / 'run').glob('*.mcap')):
        assert code == 0 and BagReader(whole[0]).counts['/eol/point'] > 0
    else:
        [aside] = (tmp_path / 'run').glob('*.damaged')
        assert aside.read_bytes() == before and code == 1
        assert str(aside) in capsys.readouterr().err


def test_recover_keeps_the_file_until_its_copy_has_been_read_back(tmp_path, capsys, monkeypatch):
    path = cut_at(tmp_path / 'run', 1.0)
    before, copy = path.read_bytes(), recover.write_file

    def broken(work, *more):
        copy(work, *more)
        data = bytearray(work.read_bytes())
        data[BagReader(work).files[0].places[0].offset + 60] ^= 4  # as by a bad disk
        work.write_bytes(data)

    monkeypatch.setattr(recover, 'write_file', broken)
    assert cli.main(['bag', 'recover', str(tmp_path / 'run')]) == 1
    assert 'left as it is' in capsys.readouterr().err
    assert [p.name for p in (tmp_path / 'run').iterdir()] == [path.name]
    assert path.read_bytes() == before


def test_recover_repairs_a_file_of_another_program_that_has_no_chunks(tmp_path):
    path, size = tmp_path / 'theirs.mcap', 0
    with open(path, 'wb') as file:
        writer = Writer(file, use_chunking=False)
        writer.start('ros2')
        schema = writer.register_schema(POINT.type, 'ros2msg', POINT.definition.encode())
        channel = writer.register_channel('/eol/point', 'cdr', schema)
        for i in range(20):
            writer.add_message(channel, T0 + i, point(i), T0, i)
            writer.flush()
            size = file.tell() if i == 11 else size
        writer.finish()
    path.write_bytes(path.read_bytes()[: size + 5])
    before = rows(path)
    assert len(before) == 12
    assert cli.main(['bag', 'recover', str(path)]) == 0
    assert rows(path) == before and BagReader(path).files[0].indexed
    assert cli.main(['bag', 'verify', str(path)]) == 0


@pytest.mark.parametrize('end', ['cut', 'whole', 'without its index'])
@pytest.mark.parametrize('lost', [4096, 8000])
def test_a_file_without_its_beginning_is_read_from_the_next_whole_chunk(
    tmp_path, capsys, end, lost
):
    long = replace(TEXT, definition='string data\n# ' + random.Random(1).randbytes(3000).hex())
    bag = BagWriter(tmp_path / 'run', [POINT, long], {'scene': 'x'})
    for i in range(300):
        bag.write('/eol/point', point(i), T0 + i * 10**7, T0, i + 1)
    bag.flush()
    bag.abandon() if end == 'cut' else bag.close()
    [path] = (tmp_path / 'run').glob('*.mcap*')
    data = bytearray(path.read_bytes())
    first_chunk = data.index(b'zstd') - 41  # which has the definitions once more
    assert 4096 < first_chunk < 8000 < BagReader(path).files[0].places[0].offset
    data[:lost] = bytes(lost)
    if end == 'without its index':
        data[-20] ^= 1  # in its checksum
    path.write_bytes(data)
    if lost > first_chunk and end == 'cut':  # no definition is left
        assert cli.main(['bag', 'recover', str(tmp_path / 'run')]) == 1
        assert any(bytes(data) == p.read_bytes() for p in (tmp_path / 'run').iterdir())
        return
    with pytest.warns(BagDamaged):
        assert [m.data for m in BagReader(path).messages()] == [point(i) for i in range(300)]
    if end == 'whole':  # the index tells where all is
        assert cli.main(['bag', 'recover', str(tmp_path / 'run')]) == 2
        assert cli.main(['bag', 'recover', str(tmp_path / 'run'), '-o', str(tmp_path / 'new')]) == 1
        assert len(rows(tmp_path / 'new')) == 300
        return
    assert cli.main(['bag', 'recover', str(tmp_path / 'run')]) == 1
    assert 'the beginning is lost' in capsys.readouterr().err
    assert cli.main(['bag', 'verify', str(tmp_path / 'run')]) == 0
    assert len(rows(tmp_path / 'run')) == 300
    [aside] = (tmp_path / 'run').glob('*.damaged')
    assert aside.read_bytes() == data


def test_verify_finds_what_was_changed_in_metadata_yaml(tmp_path):
    about = {'scene': 'nodes:\n  sound: {gain_db: -6.0}  # a caf\u00e9\n', 'seeds': '{twin: 7}'}
    write_bag(tmp_path / 'run', about=about).close()
    path = tmp_path / 'run' / 'metadata.yaml'
    text = path.read_bytes()
    assert verify(tmp_path / 'run')[1] == []
    before, missed, changed = yaml.safe_load(text), [], 0
    for at in range(0, len(text), 29):
        data = bytearray(text)
        data[at] ^= 1 << at % 7
        path.write_bytes(data)
        try:
            same = yaml.safe_load(data.decode()) == before
        except (yaml.YAMLError, ValueError):
            same = False
        try:
            found = verify(tmp_path / 'run')[1]
        except EolError as error:
            found = [str(error)]
        changed += not same
        if not found and not same:
            missed.append((at, bytes(data[at - 20 : at + 20])))
    assert not missed and changed > 50
    path.write_bytes(text.replace(b'gain_db: -6.0', b'gain_db: -9.0'))
    [line] = verify(tmp_path / 'run')[1]
    assert line.startswith('metadata.yaml: custom_data is not what the files say')
    assert cli.main(['bag', 'recover', str(tmp_path / 'run')]) == 0
    assert path.read_bytes() == text
