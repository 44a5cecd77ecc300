"""The site of `make docs` builds without a warning, offline, with all public names."""

import re
import subprocess

import pytest

import piv
from tests.conftest import ROOT

BUILDER = ROOT / ".venv-docs" / "bin" / "sphinx-build"


@pytest.mark.slow
def test_the_site(tmp_path):
    if not BUILDER.exists():
        pytest.skip("the site's builder is not installed: make docs")
    site = tmp_path / "html"
    # links that lead nowhere and pages without a place are warnings; -W makes errors of them
    command = [BUILDER, "-q", "-W", "--keep-going", "-d", tmp_path / "trees", ROOT / "docs", site]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr

    loaded = (
        r"""<(?:script|img|iframe|source|video)[^>]*\ssrc="([^"]+)"|<link[^>]*\shref="([^"]+)\""""
        r"""|(?:url\(|@import )["']?([^"')]+)"""
    )
    for page in [*site.rglob("*.html"), *site.rglob("*.css")]:
        for match in re.finditer(loaded, page.read_text(encoding="utf-8")):
            target = next(filter(None, match.groups()))
            assert not re.match(r"(https?:)?//", target), f"{page}: {target}"
    assert (site / "searchindex.js").exists()  # a script, which a browser also loads from file://

    page = (site / "site" / "python.html").read_text(encoding="utf-8")
    linked = set(re.findall(r'href="\.\./api/[^"]*#[\w.]*\.(\w+)"', page))
    assert linked == set(piv.__all__) - {"__version__"}

    # Markdown in a docstring would be shown as it is
    pages = (site / "api").rglob("*.html")
    assert not [path for path in pages if "](../" in path.read_text(encoding="utf-8")]
