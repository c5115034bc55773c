# SPDX-License-Identifier: Apache-2.0
"""Fails on words that this project once used for what the field has a name for, and on long texts.

    tools/check_words.py

What is renamed stays renamed: a word of the table in code, docs or help fails `make lint`, unless
the place is allowed, with its reason. Pages that people write have short sentences and paragraphs,
unique headings, and few words in all; so have texts of settings and commands, by the pages made of
them.
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
    r'\b[Aa]valanches?\b': 'cascade',
    r'\b(misled|astray)\b': 'outlier',
    r'\bpatience\b': 'timeout',
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
MOST_IN_SENTENCE, MOST_IN_PARAGRAPH = 35, 120
GENERATED = r'docs/reference/(api|settings|topics|scene|commands|exit_codes)\.md'
# Most words of these pages together; decision records and generated pages do not count.
MOST_WORDS = {
    r'docs/(?!adr/).*\.md': 45_000,
    r'docs/explanation/(numerics/.*|science)\.md': 6_000,
}
PROSE = re.compile(r'(README|CONTRIBUTING|SECURITY)\.md|docs/.*\.md')
PASSIVE = re.compile(r'\b(?:is|are|was|were|be|been|being) (?:told|asked|said)\b', re.I)
# (pattern of the path, pattern of the finding): why it may stand there.
ALLOWED_PROSE = {
    (r'docs/explanation/numerics/extremes\.md', r'sentence.*'): 'notes of a benchmark',
    (r'docs/reference/api\.md', r'heading twice: .*'): 'names of functions in their modules',
    (r'docs/reference/glossary\.md', r'.*: absent, accepted, .*'): 'list of words in names',
    (r'docs/build/README\.md', r'sentence.*: BT1 2 .*'): 'net of a circuit',
}
Paragraph = tuple[int, str]


def allowed(path: str, word: str) -> bool:
    """Return whether a word may stand in a file."""
    return any(re.fullmatch(p, path) and re.fullmatch(w, word) for p, w in ALLOWED)


@functools.cache
def any_of(patterns: tuple[str, ...]) -> re.Pattern:
    """Return what finds, in one pass, at least the texts in which one of `patterns` stands."""
    return re.compile(r'\b(?:' + '|'.join(p.replace(r'\b', '') for p in patterns) + ')')


def split(text: str) -> tuple[list[Paragraph], list[Paragraph]]:
    """Return paragraphs and headings of a Markdown text, each with its first line.

    A list item and a cell of a table are paragraphs of their own; code, comments and rules of
    tables are none.
    """
    text = re.sub(r'<!--.*?-->|(?ms:^```.*?^```$)', lambda m: '\n' * m[0].count('\n'), text)
    text = re.sub(r'!?\[([^\]]*)\]\([^)]*\)', r'\1', text)
    text = re.sub(r'`[^`\n]*`', 'CODE', text)
    paragraphs: list[Paragraph] = []
    headings: list[Paragraph] = []
    begun = False
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith('#'):
            headings.append((number, line.strip('# ').lower()))
        elif line.startswith('|'):
            cells = [cell for cell in line.split('|') if re.search(r'\w', cell)]
            paragraphs += [(number, cell.strip()) for cell in cells]
        elif line.strip() and not line.startswith('    '):
            if begun and not re.match(r'\s*([-*]|\d+\.) ', line):
                paragraphs[-1] = (paragraphs[-1][0], f'{paragraphs[-1][1]} {line.strip()}')
            else:
                paragraphs.append((number, re.sub(r'^\s*([-*]|\d+\.) ', '', line)))
            begun = True
            continue
        begun = False
    return paragraphs, headings


def words_of(text: str) -> int:
    """Return the number of words: what has a letter or a digit."""
    return len(re.findall(r'[^\s|]*\w[^\s|]*', text))


def prose_faults(text: str) -> list[Paragraph]:
    """Return line and description of what is too long, passive or twice in a page."""
    paragraphs, headings = split(text)
    found: list[Paragraph] = []
    for number, paragraph in paragraphs:
        if words_of(paragraph) > MOST_IN_PARAGRAPH:
            found.append((number, f'paragraph of {words_of(paragraph)} words: {paragraph[:40]}'))
        for sentence in re.split(r'(?<=[.!?])[)"*]*\s+(?=[^a-z])', paragraph):
            if words_of(sentence) > MOST_IN_SENTENCE:
                found.append((number, f'sentence of {words_of(sentence)} words: {sentence[:40]}'))
        found += [(number, f'{m[0]!r}: name who') for m in PASSIVE.finditer(paragraph)]
    seen: set[str] = set()
    for number, heading in headings:
        if heading in seen:
            found.append((number, f'heading twice: {heading}'))
        seen.add(heading)
    return found


def check_prose(pages: dict[str, str]) -> int:
    """Print what is wrong with the pages, and their words in all; return the number of faults."""
    found = 0
    totals = dict.fromkeys(MOST_WORDS, 0)
    for name, text in pages.items():
        if not PROSE.fullmatch(name):
            continue
        for pattern in MOST_WORDS:
            if re.fullmatch(pattern, name) and not re.fullmatch(GENERATED, name):
                totals[pattern] += words_of(text)
        for number, fault in prose_faults(text):
            if not any(re.fullmatch(p, name) and re.match(f, fault) for p, f in ALLOWED_PROSE):
                print(f'{name}:{number}: {fault}')
                found += 1
    for pattern, most in MOST_WORDS.items():
        print(f'{totals[pattern]} words in {pattern}, of {most} at most')
        found += totals[pattern] > most
    return found


def main() -> int:
    """Print every place with a word of the table or a fault of prose; return 1 where there is."""
    listed = subprocess.run(
        ['git', 'ls-files', '-z'], cwd=ROOT, capture_output=True, text=True, check=True
    )
    found = 0
    pages: dict[str, str] = {}
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
        if name.endswith('.md'):
            pages[name] = text
        if not any_of(tuple(words)).search(text):
            continue
        for number, line in enumerate(text.splitlines(), 1):
            for pattern, term in words.items():
                for match in re.finditer(pattern, line):
                    if not allowed(name, match.group()):
                        print(f'{name}:{number}: {match.group()!r}: the term is {term}')
                        found += 1
    return int(bool(found + check_prose(pages)))


if __name__ == '__main__':
    sys.exit(main())
