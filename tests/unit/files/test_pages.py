"""Pages stay short and readable: words, sentences, width of code."""

import re
from statistics import median

import pytest

from tests.conftest import ROOT
from tests.unit.files.test_links import PAGES

SHORT = {"README.md": 700, "CHANGELOG.md": 300}
WORDS = 2500  # a page is read in a quarter of an hour
ALL = 35_000
LONGEST, USUAL = 40, 17  # words of a sentence: any, and the median of a page
CODE = 88  # columns that the site's text column shows at 1400 px
READ = [page for page in PAGES if page.parent.name != "record"]


def prose(text):
    """Sentences of paragraphs and lists; code, tables, headings and pictures left out."""
    text = re.sub(r"(?ms)^```.*?^```|^---\n.*?^---\n", "\n\n", text)
    text = re.sub(r"(?m)^(\||#|    \S|!\[).*$", "\n", text)
    text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", re.sub(r"`[^`]*`", "x", text))
    for part in re.split(r"\n\s*\n|\n(?=(?:[-*]|\d+\.) )", text):
        yield from re.split(r"(?<=[.!?:])[*)]*\s+(?=[^a-z\d]|x )", " ".join(part.split()))


def code(text):
    """Lines of fenced and indented code."""
    fenced = "\n".join(re.findall(r"(?ms)^```[^\n]*\n(.*?)^```", text))
    rest = re.sub(r"(?ms)^```.*?^```", "", text)
    return fenced.splitlines() + [line[4:] for line in re.findall(r"(?m)^ {4}\S.*$", rest)]


@pytest.mark.parametrize("page", READ, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_is_short_and_readable(page):
    text = page.read_text(encoding="utf-8")
    assert len(text.split()) <= SHORT.get(page.name, WORDS)
    assert [line for line in code(text) if len(line) > CODE] == []
    lengths = {sentence: len(sentence.split()) for sentence in prose(text)}
    assert [sentence for sentence, words in lengths.items() if words > LONGEST] == []
    whole = [words for words in lengths.values() if words > 2]
    assert not whole or median(whole) <= USUAL


def test_all_pages_are_read_in_an_afternoon():
    words = sum(len(page.read_text(encoding="utf-8").split()) for page in PAGES)
    assert words <= ALL, f"shorten the pages by {words - ALL} words in all"
