# SPDX-License-Identifier: Apache-2.0
"""Fails on words that this project once used for what the field has a name for.

    tools/check_words.py

What is renamed stays renamed: a word of the table in code, docs or help fails `make lint`, unless
the place is allowed, with its reason.
"""

import functools
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# Each pattern with the standard term that stands in its place.
WORDS = {
    r'\bGIVER_QOS\b': 'PUBLISHER_QOS',
    r'\b(end_in_time|has_left)\b': 'arm, disarm (of the shutdown watchdog)',
    r'\bDiary\b|\bdiary\.txt\b': 'EventLog, events.log',
    r'\bbury\(': 'reap',
    r'\bclass (Audience|Meeting)\b': 'StartupBarrier, PeerDiscovery',
    r'\blooker(s|-on)?\b': 'viewer, other subscriber',
    r'\banchor_s\b': 'baseline_s',
    r'\bleave_ratio\b': 'rearm_ratio',
    r'\bswap_s\b': 'crossfade_s',
    r'\bclutter_at_sleep\b': 'relearn_background_on_sleep',
    r'\beol warm\b': 'eol compile',
    r'\beol walls\b': 'eol kiosk',
    r'\bclutter map|\bClutter(Map|Learner)\b': 'background model, BackgroundModel',
    r'\bwish(es|_of)?\b|\bWish\b': 'request; CorpusSpec, corpus_spec',
    r'\bThinning\b': 'RateLimiter',
    r'\baskew\b': 'yaw offset',
    r'\b(DIM|GLARING|FULLER)\b': 'MIN_CONTRAST, MAX_CONTRAST, MIN_FILL_GAIN',
    r'\bshare_levels\b': 'shrink_levels',
    r'\b(stray|carry|return_hidden)\(': 'reject_outliers, predict_occluded, reacquire',
    r'\b[Gg]ivers?\b|\b[Tt]akers?\b': 'publisher, subscriber',
    r'\banew\b': 'again',
    r'\bwhoever\b': 'the node, function or user by name',
    r'\b(exact1d|event2d|stepping_run|turning_step)\b': 'exact, event, stepping, rotation',
    r'\bcore/physics/(plan|run|named|lattice)\.py\b': 'choose, result, presets, kernel_args',
}
# Words that are right elsewhere and had another meaning in these files.
WORDS_THERE = {
    r'(eol_ros|test)/core/physics/.*|benchmarks/physics.*|docs/explanation/numerics/physics\.md': {
        r'\bbooks?\b|\bbooks_of\b': 'energy ledger',
        r'\blean\b': 'uncounted (without reference counting)',
        r'\b([Dd]esk|make_desk)\b': 'Workspace',
        r'\broom\b': 'capacity, empty_log; margin; arrays',
        r'\b[Tt]urn(s|ed|ing|_of|_series|ing_series)?\b': 'rotate; reverse; tick; image',
    },
}
# (pattern of the path, pattern of the word): why it may stand there.
ALLOWED = {
    (r'CHANGELOG\.rst', r'.*'): 'tells what was renamed',
    (r'tools/check_words\.py', r'.*'): 'this table',
    (r'bags/sample/metadata\.yaml', r'.*'): 'recorded before, and read as it is',
    (r'eol_ros/core/physics/.*', 'anew'): 'being rewritten',
}


def allowed(path: str, word: str) -> bool:
    """Return whether a word may stand in a file."""
    return any(re.fullmatch(p, path) and re.fullmatch(w, word) for p, w in ALLOWED)


@functools.cache
def any_of(patterns: tuple[str, ...]) -> re.Pattern:
    """Return what finds, in one pass, at least the texts in which one of `patterns` stands."""
    return re.compile(r'\b(?:' + '|'.join(p.replace(r'\b', '') for p in patterns) + ')')


def main() -> int:
    """Print every place with a word of the table; return 1 where there is one."""
    listed = subprocess.run(
        ['git', 'ls-files', '-z'], cwd=ROOT, capture_output=True, text=True, check=True
    )
    found = 0
    for name in filter(None, listed.stdout.split('\0')):
        path = ROOT / name
        if path.is_symlink() or not path.is_file():
            continue
        words = dict(WORDS)
        for there, more in WORDS_THERE.items():
            if re.fullmatch(there, name):
                words |= more
        try:
            text = path.read_text(encoding='utf-8')
        except UnicodeDecodeError:
            continue
        if not any_of(tuple(words)).search(text):
            continue
        for number, line in enumerate(text.splitlines(), 1):
            for pattern, term in words.items():
                for match in re.finditer(pattern, line):
                    if not allowed(name, match.group()):
                        print(f'{name}:{number}: {match.group()!r}: the term is {term}')
                        found += 1
    return int(bool(found))


if __name__ == '__main__':
    sys.exit(main())
