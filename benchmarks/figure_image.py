"""A figure of Plotly as a picture for documents, drawn by the browser."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import unquote

from benchmarks.browser import Browser, find_browser
from loopback.report import write_report
from loopback.report_page import chart, page
from shared_model.errors import UserError


def write_svg(figure: Any, path: Path, width: int, height: int) -> None:
    """Draw a figure into an SVG file, pixels.  Raises `UserError` if there is no browser."""
    program = find_browser()
    if program is None:
        raise UserError("pictures of charts need Chromium: apt-get install chromium")
    with TemporaryDirectory() as folder:
        html = Path(folder) / "figure.html"
        html.write_bytes(page("figure", [chart(figure)]))
        with Browser(program, Path(folder) / "profile", width, height) as browser:
            browser.call("Page.navigate", url=html.as_uri())
            browser.wait("document.querySelectorAll('.main-svg').length > 0")
            browser.value(
                "Plotly.toImage(document.querySelector('.plotly-graph-div'),"
                f" {{format: 'svg', width: {width}, height: {height}}})"
                ".then(url => { window.drawn = url; }), 0"
            )
            browser.wait("Boolean(window.drawn)")
            url = str(browser.value("window.drawn"))
    write_report(path, unquote(url.split(",", 1)[1]).encode())
