"""What the workers of a call need, loaded by the fork server that becomes them: libraries for all
of them, compiled loops for who sends and who learns, which are asked for later."""

from importlib import import_module

from runtime.child_process import start_fork_server
from runtime.fork_server import current_server

WORKERS = ("sending_worker", "drawing_worker")


def start_loading() -> None:
    """Let a fork server load libraries beside this process: the workers will have them."""
    start_fork_server(__name__, load_libraries.__name__)


def go_on_loading() -> None:
    """Let the fork server load compiled loops as well, for the workers that are asked for later."""
    if server := current_server():
        server.run(__name__, load_loops.__name__)


def load_libraries() -> None:
    """Load the libraries of all workers."""
    for worker in WORKERS:
        import_module(f"risorius.live_call.{worker}")


def load_loops() -> None:
    """Load the compiled loops of all workers."""
    from decoder.scene.decoded_model import load_loops as load_loops_of_decoder
    from encoder.live_model.warm_up import load

    load_loops_of_decoder()
    load()
