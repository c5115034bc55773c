# SPDX-License-Identifier: Apache-2.0
"""Prints docs/guides/year.md from the site into build/docs/year.pdf, with Chromium."""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

SITE = Path(__file__).parents[1] / 'build' / 'docs'


def main(site: Path = SITE) -> int:
    """Print it; without Chromium say so."""
    chromium = shutil.which('chromium') or shutil.which('google-chrome')
    if not chromium:
        print('year.pdf is not printed: there is no Chromium here', file=sys.stderr)
        return 0
    page, pdf = site / 'guides' / 'year.html', site / 'year.pdf'
    with tempfile.TemporaryDirectory() as profile:
        options = ['--headless=new', '--no-sandbox', '--disable-gpu', '--disable-sync']
        options += ['--disable-background-networking', '--no-pdf-header-footer']
        command = [chromium, *options, f'--user-data-dir={profile}', f'--print-to-pdf={pdf}']
        subprocess.run([*command, page.as_uri()], check=True, capture_output=True, timeout=120)
    print(pdf)
    return 0


if __name__ == '__main__':
    sys.exit(main())
