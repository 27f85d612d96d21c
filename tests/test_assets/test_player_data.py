"""The player's data are those of the head and of the picture codec as they are now."""

from assets.build_player_data import DATA, player_data


def test_the_file_is_what_its_sources_make() -> None:
    assert DATA.read_bytes() == player_data(), "run python -m assets.build_player_data"
