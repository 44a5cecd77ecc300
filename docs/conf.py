"""Sphinx configuration of `make docs`: pages of docs/ and docstrings, without network."""

import ast
import json
import os
import re
import sys
from pathlib import Path

DOCS = Path(__file__).parent
ROOT = DOCS.parent
sys.path.insert(0, str(ROOT))
from piv import __version__  # noqa: E402

project = "Soft finger in water"
version = release = __version__
extensions = ["myst_parser", "autoapi.extension", "sphinx.ext.napoleon"]
napoleon_google_docstring = False
myst_heading_anchors = 4
exclude_patterns = ["evidence"]  # of its benchmark, the page that goes with the recordings
highlight_language = "none"
suppress_warnings = [
    "autoapi.python_import_resolution",  # of names that a module sets several at once
    "docutils",  # docstrings are plain text: one that looks like a broken list is shown as it is
]

# Read, not imported: the site needs none of the project's own libraries.
autoapi_dirs = [str(ROOT / package) for package in ("piv",)]
autoapi_root = "api"
autoapi_add_toctree_entry = False
autoapi_options = ["members", "show-module-summary"]
autoapi_python_class_content = "both"
autoapi_member_order = "bysource"

html_theme = "furo"
html_title = "Soft finger in water"
html_show_copyright = False
html_copy_source = False
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme_options = {"navigation_with_keys": True}

# Pages from files outside docs/: heading, file, and pattern of the included text.
RESULTS = "cases/single_finger/kinematics/studies/results.md"
TAKEN = {
    "site/first_hour": (
        "# First hour\n\n## Run it\n",
        "README.md",
        r"\n## Run it\n(.*)\n## What to trust\n",
    ),
    "site/trust": ("# What to trust\n", "README.md", r"\n## What to trust\n(.*)\n## Read on"),
    "site/contributing": ("# Contributing\n", "CONTRIBUTING.md", r"# Contributing\n(.*)"),
    "site/changelog": ("# Changelog\n", "CHANGELOG.md", r"# Changelog\n(.*)"),
    "site/fea_results": (
        "---\norphan: true\n---\n# Results of the bending studies\n",
        RESULTS,
        r"#[^\n]*\n(.*)",
    ),
}
PAGE_NAME = re.compile(r"(?<!\]\()(?<![`/\w])docs/(\w+)\.md(?!`)")
PAGE_OF = {file: page for page, (_, file, _) in TAKEN.items()} | {"README.md": "index"}


def fill_page(app, page, source):
    """Fill a page of TAKEN or the public names; point links at pages of the site."""
    text, folder = source[0], (DOCS / page).parent
    if page.startswith("api/"):  # reStructuredText, not Markdown
        source[0] = PAGE_NAME.sub(
            lambda name: f":doc:`/{name[1]}`" if is_page(name[1]) else name[0], text
        )
        return
    if page in TAKEN:
        head, file, pattern = TAKEN[page]
        app.env.note_dependency(str(ROOT / file))  # else the page stays as it was
        whole = (ROOT / file).read_text(encoding="utf-8")
        taken = re.search(pattern, whole, re.DOTALL)
        if not taken:
            raise ValueError(
                f"{file}: lacks the headings between which docs/conf.py takes its text: {pattern}"
            )
        text = head + taken[1]
        folder = (ROOT / file).parent
    if page == "site/python":
        text += public_names()
    text += origins(text, folder)
    source[0] = relink(name_pages(text, folder), folder, (DOCS / page).parent)


def origins(text, of):
    """When, and on which commit, the tables were made that `text` of folder `of` names."""
    made = []
    for file in dict.fromkeys(re.findall(r"[\w./-]+\.csv", text)):
        first = (of / file).open(encoding="utf-8").readline() if (of / file).is_file() else ""
        head = json.loads(first[1:]) if first.startswith("# {") else {}
        if "commit" in head:
            made.append(f"`{Path(file).name}` {head['made']}, commit {head['commit']}")
    return f"\n\n*Made by commands: {'; '.join(made)}.*\n" if made else ""


def name_pages(text, of):
    """`text` of folder `of` with links in place of the plain names of pages, `docs/mesh.md`."""

    def link(name):
        return (
            f"[{name[1]}]({os.path.relpath(DOCS, of)}/{name[1]}.md)"
            if is_page(name[1])
            else name[0]
        )

    return PAGE_NAME.sub(link, text)


def is_page(name):
    """Whether docs/ has a page of this name."""
    return (DOCS / f"{name}.md").exists()


def relink(text, of, to):
    """`text` of folder `of` with its relative links as they read from folder `to`."""

    def new(link):
        path = Path(os.path.normpath(of / link["path"]))
        if path.is_relative_to(ROOT) and (page := PAGE_OF.get(str(path.relative_to(ROOT)))):
            path = DOCS / f"{page}.md"
        return f"]({os.path.relpath(path, to)}{link['anchor'] or ''})"

    return re.sub(r"\]\((?![a-z]+:|#)(?P<path>[^)#\s]+)(?P<anchor>#[^)\s]*)?\)", new, text)


def public_names():
    """The public names of `piv`: link to the description, first line of it, and its example."""
    modules = value_of("_MODULES", ROOT / "piv" / "__init__.py")
    parts = [""]
    for module, names in modules.items():
        file = ROOT / f"{module.replace('.', '/')}.py"
        nodes = ast.parse(file.read_text(encoding="utf-8")).body
        texts = {node.name: ast.get_docstring(node) for node in nodes if hasattr(node, "name")}
        for name in names:
            about, _, example = texts[name].partition("Examples\n--------\n")
            parts.append(f"## {name}\n{{py:obj}}`{module}.{name}`: {about.splitlines()[0]}\n")
            parts.append(f"```python\n{example.strip()}\n```\n")
    return "\n".join(parts)


def value_of(name, file):
    """The literal that a module assigns to a name."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    value = next(
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and node.targets[0].id == name
    )
    return ast.literal_eval(value)


def as_restructured_text(app, what, name, obj, options, lines):
    """Docstrings are plain text with `code`: mark the code, take all other letters as they are."""
    text, heading, example = "\n".join(lines).partition("\nExamples\n--------\n")
    parts = re.split(r"(`+[^`]+`+)", text)
    marked = (
        f"``{part.strip('`')}``"
        if part.startswith("`")
        else re.sub(r"([*|`\\]|(?<=\w)_(?=\W|$))", r"\\\1", part)
        for part in parts
    )
    lines[:] = ("".join(marked) + heading + example).split("\n")


def setup(app):
    app.connect("source-read", fill_page)
    # before napoleon reads the sections
    app.connect("autodoc-process-docstring", as_restructured_text, priority=100)
