"""The pages' templates: a name that a page does not fill in is an error, and text is escaped."""

import base64
from pathlib import Path

import jinja2

_TEMPLATES = Path(__file__).parent / "templates"
_MIME = {".png": "image/png", ".svg": "image/svg+xml", ".webp": "image/webp", ".webm": "video/webm"}


def page_template(name: str) -> jinja2.Template:
    """One of postprocess/templates, ready to be rendered."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


def data_uri(suffix: str, content: bytes) -> str:
    """A file's content as an address within a page; `suffix`: that of its name."""
    return f"data:{_MIME[suffix]};base64,{base64.b64encode(content).decode()}"
