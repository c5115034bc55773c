# SPDX-License-Identifier: Apache-2.0
"""Videos on the walls in a real Chromium: each image of them is as bright as it is late."""

import cv2
import numpy as np
import pytest
from PIL import Image
from support import needs
from support.chromium import reduced_motion, run, until_page, visit

from eol_ros.devices.files.media_folder import LIST, MediaFolder, Pictures

pytestmark = needs.marker('chromium', 'chromium-driver')
IMAGES, FPS = 40, 20  # 2 s; image i has the grey 40 + 4 i
LOOK = """
window.grey = () => {
  const {view} = eol, small = new OffscreenCanvas(8, 8).getContext('2d');
  small.drawImage(view.layers[view.front], 0, 0, 8, 8);
  return small.getImageData(4, 4, 1, 1).data[1];
};
window.turn = (change, left, looks, more = {}) => {
  const wall = {change, left, right: '', caption: '', credit: '', ahead: [], flip: 0, fade: 0};
  eol.link.emit('wall', {...wall, moving: true, looks, ...more});
};
window.greys = []; // of each image that the layer in front was given
const {view} = eol, {paint} = view;
view.paint = (layer, name) => {
  paint.call(view, layer, name);
  if (layer === view.front) greys.push(grey());
};
"""


def video(path, code):
    out = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), FPS, (160, 90))
    for i in range(IMAGES):
        out.write(np.full((90, 160, 3), 40 + 4 * i, np.uint8))
    out.release()


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('videos')
    video(folder / 'crack.webm', 'VP80')
    video(folder / 'flood.mp4', 'vp09')
    for i in range(8):
        (folder / f'{i}.webm').write_bytes((folder / 'crack.webm').read_bytes())
    images = [Image.fromarray(np.full((9, 16), 40 + 4 * i, np.uint8)) for i in range(IMAGES)]
    images[0].save(
        folder / 'lean.gif', save_all=True, append_images=images[1:], duration=1000 // FPS, loop=0
    )
    cv2.imwrite(str(folder / 'flood.png'), np.full((90, 160, 3), 250, np.uint8))
    (folder / LIST).write_text(
        'left,right,caption,credit,play\ncrack.webm,flood.mp4,,,damage\nlean.gif,lean.gif,,,once\n'
        + ''.join(f'{i}.webm,flood.mp4\n' for i in range(8))
    )
    return folder


def test_what_the_folder_says_a_browser_plays_it_plays(folder, serve, browser):
    media = MediaFolder(folder)
    assert media.skipped == []
    server = serve(Pictures(str(folder)).file)
    visit(browser, f'http://127.0.0.1:{server.port}', '/wall/left', 320, 180)
    run(browser, LOOK)
    for change, name in enumerate(['crack.webm', 'flood.mp4', 'lean.gif'], 1):
        run(browser, f'turn({change}, "{name}", {{}}); greys = []')
        until_page(browser, f'eol.view.shows === "{name}" && grey() > 120')
        seen = run(browser, 'return greys')
        assert min(seen) >= 35 and len(set(seen)) > 5, seen


@pytest.fixture
def wall(folder, serve, browser):
    """A wall that is told by `turn` what to show, and a list of what it holds open."""
    server = serve(Pictures(str(folder)).file)
    visit(browser, f'http://127.0.0.1:{server.port}', '/wall/left', 320, 180)
    run(browser, LOOK)
    return browser


def look(name, play, poster=''):
    return f'{{"{name}": ["cover", 0.5, 0.5, "{play}", "{poster}"]}}'


@pytest.mark.parametrize('name', ['crack.webm', 'lean.gif'])
def test_damage_runs_forward_and_heals_by_a_fade(wall, name):
    degree = [f'{name}#{percent}' for percent in (0, 33, 100)]
    looks = '{' + ', '.join(look(each, 'damage')[1:-1] for each in degree) + '}'
    run(wall, f'turn(1, "{degree[1]}", {looks})')  # it comes with the damage that is there
    until_page(wall, f'eol.view.shows === "{degree[1]}" && Math.abs(grey() - 92) < 8')
    run(wall, f'greys = []; turn(2, "{degree[2]}", {looks})')  # a greater cascade
    until_page(wall, 'grey() >= 188 && !eol.view.fading')
    seen = run(wall, 'return greys')
    assert seen == sorted(seen) and len(set(seen)) > 4 and min(seen) > 80  # it ran there
    run(wall, f'greys = []; turn(3, "{degree[0]}", {looks})')  # calm
    until_page(wall, f'eol.view.shows === "{degree[0]}" && Math.abs(grey() - 40) < 8')
    assert run(wall, 'return eol.view.fading') is True  # from the picture before, which stands


def test_once_holds_its_last_image_and_moving_waits_for_a_cascade(wall):
    run(wall, f'turn(1, "crack.webm", {look("crack.webm", "once")})')
    until_page(wall, 'eol.view.shows && eol.view.films.get("crack.webm").image.ended')
    until_page(wall, 'grey() > 190')
    run(wall, f'turn(1, "crack.webm", {look("crack.webm", "once")}, {{moving: false}})')
    assert run(
        wall, 'return eol.view.films.get("crack.webm").image.ended'
    )  # not from its beginning
    moving = look('flood.mp4', 'moving')
    run(wall, f'turn(2, "flood.mp4", {moving}, {{moving: false}})')
    until_page(wall, 'eol.view.shows === "flood.mp4"')
    assert run(wall, 'return eol.view.films.get("flood.mp4").image.paused && grey() < 48')
    run(wall, f'turn(2, "flood.mp4", {moving})')
    until_page(wall, 'grey() > 70')
    run(wall, f'turn(2, "flood.mp4", {moving}, {{moving: false}})')
    assert run(
        wall, 'const {image} = eol.view.films.get("flood.mp4"); return image.paused && !image.ended'
    )


def test_only_what_is_shown_and_what_comes_next_is_open(wall):
    """However many videos are announced; those that go leave neither decoder nor data."""
    run(wall, """
        window.opened = new Set();
        const create = document.createElement.bind(document);
        document.createElement = (kind) => {
          const made = create(kind);
          if (kind === 'video') opened.add(made);
          return made;
        };
    """)  # fmt: skip
    names = [f'{i}.webm' for i in range(8)]
    for change in range(1, 7):
        ahead = [each for name in (names[change:] + names)[:4] for each in (name, '')]
        run(wall, f'turn({change}, "{names[change - 1]}", {{}}, {{ahead: {ahead}}})')
        until_page(wall, f'eol.view.current.change === {change} && !eol.view.pending')
        assert run(wall, 'return eol.view.films.size') <= 2
    held = 'return [...opened].filter((video) => video.getAttribute("src")).length'
    assert run(wall, 'return opened.size') >= 7 and run(wall, held) <= 2
    assert run(wall, 'return [...opened].filter((video) => !video.paused).length') <= 1
    run(wall, 'turn(9, "", {})')  # asleep
    until_page(wall, '!eol.view.pending && eol.view.films.size === 0')
    assert run(wall, held) == 0


def test_a_poster_stands_until_its_video_is_there_and_where_it_never_comes(folder, serve, browser):
    late = []
    pictures = Pictures(str(folder))
    server = serve(lambda name: None if name == 'flood.mp4' and not late else pictures.file(name))
    visit(browser, f'http://127.0.0.1:{server.port}', '/wall/left', 320, 180)
    run(browser, LOOK)
    with_poster = look('flood.mp4', 'loop', 'flood.png')
    run(browser, f'turn(1, "flood.mp4", {with_poster})')
    until_page(browser, 'eol.view.shows === "flood.mp4" && grey() > 240')
    until_page(
        browser, '!eol.view.films.size'
    )  # it failed, and is asked for again at the next word
    late.append(True)
    run(browser, f'greys = []; turn(1, "flood.mp4", {with_poster})')
    until_page(browser, 'grey() < 200 && grey() > 60')
    assert min(run(browser, 'return greys')) > 35  # never black between


@pytest.mark.parametrize('fit', ['cover', 'contain'])
def test_a_video_without_an_image_at_the_moment_leaves_what_was_there(wall, fit):
    """As while a browser seeks in it, or when its first image is read but not yet decoded."""
    run(wall, 'turn(1, "crack.webm", {})')
    until_page(wall, 'eol.view.shows === "crack.webm" && grey() > 45')
    shown, after = run(
        wall,
        f"""
        const one = eol.view.films.get('crack.webm'), {{width, height}} = one;
        one.hold();
        const shown = grey();
        eol.view.looks['crack.webm'] = ['{fit}', 0.5, 0.5, 'loop', ''];
        const none = {{image: document.createElement('video'), width, height, ready: true}};
        eol.view.films.set('crack.webm', none);
        eol.view.paint(eol.view.front, 'crack.webm');
        const after = grey();  // at once: the page may paint a newer image of the video then
        eol.view.films.set('crack.webm', one);
        return [shown, after];
    """,
    )
    assert shown == after > 45


def test_where_movement_is_unwelcome_videos_stand(wall):
    with reduced_motion(wall):
        run(wall, 'turn(1, "crack.webm", {})')
        until_page(wall, 'eol.view.shows === "crack.webm"')
        assert run(wall, 'return eol.view.films.get("crack.webm").image.paused')
        assert run(wall, 'return grey()') < 48
