"""The documents: every link leads somewhere, every file that they name is there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])
# [text](target), but not of a picture's address on the network.
LINK = re.compile(r"\]\(([^)\s]+)\)")
# `encoder/fitting/identity.py` and the like.
FILE = re.compile(
    r"`((?:shared_model|protocol|encoder|decoder|aam|loopback|risorius|benchmarks|assets|scripts|tests)/[\w./]+\.\w+)`"
)


def anchors(document: Path) -> set[str]:
    """The addresses of a document's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", document.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_to_files_and_headings(document: Path) -> None:
    for target in LINK.findall(document.read_text(encoding="utf-8")):
        if "://" in target:
            continue
        name, _, anchor = target.partition("#")
        found = (document.parent / name).resolve() if name else document
        assert found.exists(), f"{document.name}: {target} leads nowhere"
        assert not anchor or anchor in anchors(found), f"{document.name}: no heading {target}"


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_named_files_exist(document: Path) -> None:
    # A changelog names what was there at its time.
    if document.name == "CHANGELOG.md":
        return
    missing = [
        name
        for name in FILE.findall(document.read_text(encoding="utf-8"))
        if not (ROOT / name).exists()
    ]
    assert not missing
