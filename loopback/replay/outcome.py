"""The outcome of a suite: a table for people, JUnit XML for a CI."""

import xml.etree.ElementTree as ElementTree

from loopback.replay.runs import ClipResult
from loopback.replay.suite import Suite
from loopback.report import Cell, table


def replay_table(results: list[ClipResult]) -> str:
    """Each threshold of each clip with what was measured."""
    rows: list[list[Cell]] = []
    for result in results:
        rows += [
            [result.name, check.figure, check.rule, check.value, "ok" if check.passed else "MISSED"]
            for check in result.checks
        ]
        if result.error is not None:
            rows.append([result.name, "-", result.error, None, "FAILED"])
        elif not result.checks:
            rows.append([result.name, "-", "none", None, "ok"])
    return table(("clip", "figure", "threshold", "measured", ""), rows)


def junit_xml(suite: Suite, results: list[ClipResult]) -> bytes:
    """The results as JUnit XML: one test case for each threshold, or for a clip that failed."""
    root = ElementTree.Element("testsuite", name=suite.name)
    for result in results:
        for item in result.checks:
            case = _case(root, result.name, f"{item.figure} {item.rule}")
            if not item.passed:
                ElementTree.SubElement(case, "failure", message=f"measured {item.value}")
        if result.error is not None:
            ElementTree.SubElement(_case(root, result.name, "run"), "error", message=result.error)
        elif not result.checks:
            _case(root, result.name, "run")
    root.set("tests", str(len(root)))
    root.set("failures", str(len(root.findall("testcase/failure"))))
    root.set("errors", str(len(root.findall("testcase/error"))))
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))


def _case(root: ElementTree.Element, clip: str, name: str) -> ElementTree.Element:
    return ElementTree.SubElement(
        root, "testcase", classname=f"{root.get('name')}.{clip}", name=name
    )
