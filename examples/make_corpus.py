# SPDX-License-Identifier: Apache-2.0
"""A corpus of your own from an array: rising tones, cut into grains and placed by descriptors.

    python examples/make_corpus.py FOLDER       writes tones.wav and tones.json there

A scene plays it with `grains: {sound: FOLDER/tones.wav}`; `eol corpus FOLDER/tones.wav` shows it.
"""

import argparse
import sys

import numpy as np

from eol_ros import folders
from eol_ros.devices.audio import audio_file
from eol_ros.devices.corpus import corpus_build, corpus_file
from eol_ros.errors import EolError

RATE, SECONDS = 48000, 0.25


def main() -> None:
    parser = argparse.ArgumentParser(description='Write tones.wav and tones.json.')
    parser.add_argument('folder')
    folder = folders.made(parser.parse_args().folder, 'FOLDER')
    t = np.arange(int(RATE * SECONDS)) / RATE
    tones = [np.sin(2 * np.pi * hz * t) for hz in np.geomspace(110, 1760, 16)]
    wave = 0.3 * np.concatenate(tones) * np.tile(np.hanning(len(t)), len(tones))
    audio_file.write(folder / 'tones.wav', wave.astype(np.float32), RATE)
    options = corpus_file.Options(grain_s=SECONDS, layout='rank')
    corpus = corpus_build.build([folder / 'tones.wav'], options)
    corpus_file.save(corpus, folder / 'tones.json')
    print(f'{len(corpus)} grains; {corpus.x_name} from left to right:')
    for grain in corpus.grains:
        print(f'{grain["start_s"]:5.2f} s  {grain["centroid_mean_hz"]:6.0f} Hz  x {grain["x"]:.2f}')


if __name__ == '__main__':
    try:
        main()
    except EolError as error:  # what a user can cause or meet, in one line
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
