"""`wrinkle edit`."""

import gc
import html
import logging
import os
import re
import signal
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

import click

from wrinklecli.cli import options as opt
from wrinklecli.cli.output import emit, say, say_findings, warn
from wrinklecli.errors import WrinkleError
from wrinklecli.files.workplace import Workplace

_PORT = 8765
_NAME = re.compile(r"([A-Za-z0-9._-]+)")


def _host(value: str) -> str:
    if not value:  # which would be every address
        raise ValueError("expected an address or a name; 0.0.0.0 is every address")
    return value


def _names(values: tuple[str, ...]) -> tuple[str, ...]:
    for value in values:
        opt.parsed(value, _NAME, "a name such as studio.example, without http:// and port")
    return values


@click.command(
    short_help="Serve a page on which tools are drawn and tuned.",
    epilog="Example: wrinkle edit samples/trousers.glb configs/trousers.yaml",
)
@click.argument("asset", type=opt.FILE)
@click.argument("tools", type=opt.FILE, required=False)
@opt.anim()
@opt.range_of_motion("Without clips this is the default.")
@opt.presets("TOOLS gets their name, as a step that can be undone.")
@opt.flag("--heat", text="Begin with the surface coloured by its compression.")
@opt.whole("--port", bounds=(0, 65_535), text="The port of the page; 0 takes any port that is free.", default=_PORT)
@opt.valued(
    "--host",
    text="The address to listen on. Anyone who has the printed address, with its token, sees and changes everything.",
    default="127.0.0.1",
    read=_host,
)
@opt.valued(
    "--allow-host",
    text="Also open the page by this name, such as that of this machine or of a proxy; may be repeated. Addresses,"
    " localhost and --host are always allowed.",
    metavar="NAME",
    multiple=True,
    read=_names,
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
    allow_host: tuple[str, ...],
    heat: bool,
    no_browser: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Draw wrinkling tools on ASSET (glTF) with the mouse, in a web page, while its clips play.

    TOOLS is the YAML file that the page opens and saves. Without TOOLS, the file has the name of ASSET with the ending
    .yaml. If the file does not exist, the page begins without tools. Comments, order and lines that are not edited
    stay as they were. Edits that are not saved are kept in your own folder for settings, and the next run takes
    them up. A page that this machine alone reaches also opens assets that were edited before, from a list.

    The page needs no network, but viser, embreex and Pillow: pip install 'wrinklecli[edit]'. Ctrl-C ends it. It opens
    only at the printed address with its token, which other users of this machine do not know. The name in the address
    must be localhost, or one given by --host or --allow-host. Other sites cannot open it.

    Exit codes: 0 done; 1 the input is at fault, or the port is taken; 2 wrong usage; 70 a bug.
    """
    from wrinklecli.numeric.guard import guarded

    with guarded(asset):
        from wrinklecli.editor.asset import ReadOptions
        from wrinklecli.editor.recent import recent, remember
        from wrinklecli.editor.session import Session
        from wrinklecli.review.preview.preview import refuse_missing

        refuse_missing("edit")
        try:
            from wrinklecli.editor.page.access import Access, is_own
            from wrinklecli.editor.page.page import Page
        except ImportError as error:
            raise WrinkleError(f"needs viser ({error}): pip install 'wrinklecli[edit]'", where="edit") from None
    shown = logging.StreamHandler()  # of bugs, after which the page goes on
    shown.setLevel(logging.ERROR)
    logging.getLogger("wrinklecli").addHandler(shown)
    gc.freeze()  # what is imported stays, and what tabs leave is found in a tenth of the time without it
    ended = threading.Event()

    def end(_number: int, _frame: FrameType | None) -> None:
        ended.set()

    own_folder = click.get_app_dir("wrinkle")
    session = Session(asset, tools, ReadOptions(**options), own_folder)
    kept = os.path.join(own_folder, "recent.json")
    # A page that other machines reach opens only what lies beside the shown asset.
    known = recent(kept) if is_own(host) else {}
    page = Page(session, Access.to(host, allow_host), port, heat=heat, known=known)
    remember(kept, page.known)
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, end)
    emit(page.address)
    if not quiet:
        if not is_own(host):
            warn(
                "whoever has this address sees the asset and changes the tools; it goes over the network as plain text"
            )
        say(f"edits {session.path}; Ctrl-C ends it")
        say_findings(session.notes, ())
    with nullcontext() if no_browser else _browser_at(page.address, os.path.dirname(session.path)):
        # In steps, as a thread that waits for ever hears no signal on Windows.
        while not ended.wait(0.5):
            if page.wanted is not None:
                page = page.instead()
                remember(kept, page.known)
                say(f"edits {page.session.path}")
                say_findings(page.session.notes, ())
    page.close()
    if page.session.changed:
        warn(f"{page.session.path}: not all was saved")


@contextmanager
def _browser_at(address: str, folder: str) -> Iterator[None]:
    """Open a browser at an address by a file that leads there, is this user's alone, and goes when the block ends.

    The command line of a browser is shown to all users of a machine, so that the token must not stand there. The file
    lies in `folder`, since many browsers may not read temporary files; or with these, if it cannot be written there.
    """
    import tempfile
    import webbrowser

    refresh = html.escape(f"0; url={address}")
    text = f'<!DOCTYPE html><meta charset="utf-8"><meta http-equiv="refresh" content="{refresh}"><p>wrinkle edit</p>\n'
    with ExitStack() as stack:
        for parent in (folder, tempfile.gettempdir()):
            place = Workplace(os.path.abspath(parent))
            stack.callback(place.remove)
            with suppress(OSError):
                place.make()
                inner = place.next_path()
                os.mkdir(inner, 0o700)
                path = os.path.join(inner, "edit.html")
                with open(path, "x", encoding="utf-8", opener=partial(os.open, mode=0o600)) as file:
                    file.write(text)
                webbrowser.open(Path(path).as_uri())
                break
        yield
