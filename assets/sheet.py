# SPDX-License-Identifier: Apache-2.0
"""Prints docs/guides/year.md from the site into build/docs/year.pdf, with Chromium."""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

SITE = Path(__file__).parents[1] / 'build' / 'docs'
CHROMIUM = shutil.which('chromium') or shutil.which('google-chrome')


def main(site: Path = SITE) -> int:
    """Print it; without Chromium say so."""
    if not CHROMIUM:
        print('year.pdf is not printed: there is no Chromium here', file=sys.stderr)
        return 0
    pdf = site / 'year.pdf'
    try:
        page = (site / 'guides' / 'year.html').as_uri()
        browse(page, '--no-pdf-header-footer', f'--print-to-pdf={pdf}')
    except (OSError, subprocess.SubprocessError) as error:
        print(f'year.pdf is not printed: {error}', file=sys.stderr)
        return 1
    print(pdf)
    return 0


def browse(url: str, *options: str) -> str:
    """Open `url` in Chromium with a profile of its own; return what Chromium prints."""
    with tempfile.TemporaryDirectory() as profile:
        own = ['--headless=new', '--no-sandbox', '--disable-gpu', '--disable-sync']
        own += ['--disable-background-networking', f'--user-data-dir={profile}', *options]
        return subprocess.run(
            [str(CHROMIUM), *own, url], check=True, capture_output=True, text=True, timeout=120
        ).stdout


if __name__ == '__main__':
    sys.exit(main())
