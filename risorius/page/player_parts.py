"""The files of the player, as pages and letters have them."""

from importlib.resources import files

from shared_model.errors import UserError

# Of the page that watches a call from elsewhere.
WATCH_PAGE = "watch/watch.html"
WATCH_PARTS = "page/page.css", "built/watch.js", "built/opus.js", "data/player.bin"


def player_part(name: str) -> bytes:
    """A file of the player.

    name: its path in the package `player`.
    Raises `UserError` if it is built of the sources and has not been.
    """
    try:
        return files("player").joinpath(name).read_bytes()
    except FileNotFoundError as error:
        raise UserError(
            f"the player's {name} has not been built; run make player in the sources, it needs node"
        ) from error
