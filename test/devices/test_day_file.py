# SPDX-License-Identifier: Apache-2.0
"""What survives a restart, and what does not stop the show."""

from eol_ros.devices.files.day_file import SAVE_EVERY_S, DayFile


def test_what_is_saved_is_found_again_by_the_same_name(tmp_path, monkeypatch):
    monkeypatch.setenv('EOL_STATE', str(tmp_path / 'state'))
    file = DayFile('twin+panel/../x')
    assert file.load() is None
    file.save({'areas': [1, 2]}, 100.0)
    assert DayFile('twin+panel/../x').load() == {'areas': [1, 2]}
    assert DayFile('other').load() is None
    assert file.path.parent == tmp_path / 'state'
    assert not list(file.path.parent.glob('*.part'))


def test_it_writes_seldom(tmp_path, monkeypatch):
    monkeypatch.setenv('EOL_STATE', str(tmp_path))
    file = DayFile('museum')
    file.save(1, 100.0)
    file.save(2, 100.0 + SAVE_EVERY_S / 2)
    assert file.load() == 1
    file.save(2, 100.0 + SAVE_EVERY_S)
    assert file.load() == 2


def test_a_broken_file_counts_as_none_and_a_full_disk_is_told(tmp_path, monkeypatch):
    monkeypatch.setenv('EOL_STATE', str(tmp_path))
    file = DayFile('museum')
    file.path.write_bytes(b'{"areas": [1,\xff')
    assert file.load() is None
    (tmp_path / 'file').write_text('')
    monkeypatch.setenv('EOL_STATE', str(tmp_path / 'file'))
    file = DayFile('museum')
    file.save(1, 0.0)
    assert 'a restart will forget it' in file.trouble and '\n' not in file.trouble
