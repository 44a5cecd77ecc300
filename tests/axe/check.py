"""Accessibility of a page by axe, a library of rules, in a browser."""

import json
from pathlib import Path

from tests.webdriver import Browser

OPEN = "document.querySelectorAll('details').forEach(d => d.open = true);"
AXE = Path(__file__).with_name("axe.min.js")


def serious_findings(browser: Browser) -> dict[str, list[str]]:
    """Rules that the open page breaks seriously, with elements; its folded parts are opened."""
    # by devtools, since the page allows no scripts
    browser.devtools("Runtime.evaluate", expression=OPEN + AXE.read_text(encoding="utf-8"))
    report = "axe.run().then(r => JSON.stringify([r.violations, r.passes.length]))"
    options = {"expression": report, "awaitPromise": True, "returnByValue": True}
    answer = browser.devtools("Runtime.evaluate", **options)
    violations, passed = json.loads(answer["result"]["value"])
    assert passed > 15, "axe must have checked the page"
    serious = [f for f in violations if f["impact"] in ("serious", "critical")]
    return {f["id"]: [n["html"][:120] for n in f["nodes"][:3]] for f in serious}
