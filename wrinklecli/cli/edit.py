"""`wrinkle edit`."""

import signal
import threading
import webbrowser
from types import FrameType
from typing import Any

import click

from wrinklecli.cli import options as opt
from wrinklecli.cli.output import emit, say, say_findings, warn
from wrinklecli.errors import WrinkleError

_PORT = 8765


@click.command(
    short_help="Serve a page on which tools are drawn and tuned.",
    epilog="Example: wrinkle edit samples/trousers.glb configs/trousers.yaml",
)
@click.argument("asset", type=opt.FILE)
@click.argument("tools", type=opt.FILE, required=False)
@opt.anim()
@opt.range_of_motion("Without clips that is done anyway.")
@opt.flag("--heat", text="Begin with the surface coloured by its compression.")
@opt.whole("--port", bounds=(0, 65_535), text="The port of the page; 0 takes any port that is free.", default=_PORT)
@opt.valued(
    "--host",
    text="The address to listen on. At any other than this machine's own, whoever reaches it sees and changes all.",
    default="127.0.0.1",
)
@opt.flag("--no-browser", text="Print the page's address, and open no browser.")
@opt.allow_external()
@opt.max_memory
@opt.quiet("Print nothing but the address, and errors.")
def edit(
    asset: str,
    tools: str | None,
    port: int,
    host: str,
    heat: bool,
    no_browser: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Draw wrinkling tools on ASSET (glTF) with the mouse, in a web page, while its clips play.

    TOOLS is the YAML file that the page opens and saves. Without TOOLS, the file has the name of ASSET with the ending
    .yaml. If the file does not exist, the page begins without tools. Comments, order and lines that are not edited
    stay as they were.
    The page needs no network, but viser: pip install 'wrinklecli[edit]'. Ctrl-C ends it.

    Exit codes: 0 done; 1 the input is at fault, or the port is taken; 2 wrong usage; 70 a bug.
    """
    from wrinklecli.numeric.guard import guarded

    with guarded(asset):
        from wrinklecli.editor.asset import ReadOptions
        from wrinklecli.editor.session import Session

        try:
            from wrinklecli.editor.page.page import Page
            from wrinklecli.editor.page.server import is_own
        except ImportError as error:
            raise WrinkleError(f"needs viser ({error}): pip install 'wrinklecli[edit]'", where="edit") from None
    ended = threading.Event()

    def end(_number: int, _frame: FrameType | None) -> None:
        ended.set()

    session = Session(asset, tools, ReadOptions(**options))
    page = Page(session, host, port, heat=heat)
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, end)
    address = f"http://{f'[{host}]' if ':' in host else host}:{page.port}"
    emit(address)
    if not quiet:
        if not is_own(host):
            warn(f"whoever reaches {host} sees the asset and changes the tools: the page asks for no password")
        say(f"edits {session.path}; Ctrl-C ends it")
        say_findings(session.notes, ())
    if not no_browser:
        webbrowser.open(address)
    # In steps, as a thread that waits for ever hears no signal on Windows.
    while not ended.wait(0.5):
        pass
    page.close()
    if session.changed:
        warn(f"{session.path}: not all was saved")
