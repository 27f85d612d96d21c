"""Tables and reports for people."""

from loopback.report import TERMINAL_WIDTH, table, wrapped_table


def test_a_wide_table_is_wrapped_and_repeats_its_first_column() -> None:
    header = ["clip", *(f"figure {number}" for number in range(20))]
    rows = [[name, *range(20)] for name in ("one.mp4", "another.mp4")]
    text = wrapped_table(header, rows)
    assert max(map(len, text.splitlines())) <= TERMINAL_WIDTH
    parts = text.split("\n\n")
    assert len(parts) > 1 and all(part.startswith("clip") for part in parts)
    found = [word for part in parts for word in part.splitlines()[2].split()[1:]]
    assert found == [str(number) for number in range(20)]
    assert wrapped_table(header[:3], [row[:3] for row in rows]) == table(
        header[:3], [row[:3] for row in rows]
    )
