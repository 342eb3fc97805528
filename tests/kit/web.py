"""A web server on this machine whose answers are slow, endless, or larger than they look."""

import gzip
import io
import tarfile
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Event, Thread

Answer = Callable[[BaseHTTPRequestHandler, Event], None]
BLOCK = bytes(2**16)


def sound(data: bytes, **headers: str) -> Answer:
    """All bytes at once."""

    def answer(request: BaseHTTPRequestHandler, _: Event) -> None:
        begin(request, len(data), **headers)
        request.wfile.write(data)

    return answer


def begin(request: BaseHTTPRequestHandler, size: int | None, **headers: str) -> None:
    """The head of an answer; without a size it lasts until the server closes the connection."""
    request.send_response(200)
    for name, value in headers.items():
        request.send_header(name.replace("_", "-"), value)
    if size is not None:
        request.send_header("Content-Length", str(size))
    request.end_headers()


def announced(request: BaseHTTPRequestHandler, ended: Event) -> None:
    """Say that 10 GB follow, and send some."""
    begin(request, 10**10)
    request.wfile.write(BLOCK)
    ended.wait()


def endless(request: BaseHTTPRequestHandler, ended: Event) -> None:
    """Send bytes for ever, and do not say how many."""
    begin(request, None)
    while not ended.is_set():
        request.wfile.write(BLOCK)


def stopped(request: BaseHTTPRequestHandler, ended: Event) -> None:
    """Send a byte, and no more."""
    begin(request, 1000)
    request.wfile.write(b"v")
    ended.wait()


def silent(_: BaseHTTPRequestHandler, ended: Event) -> None:
    """Never answer."""
    ended.wait()


def dribbled(request: BaseHTTPRequestHandler, ended: Event) -> None:
    """Send a byte every twentieth of a second, for ever."""
    begin(request, 10**6)
    while not ended.wait(0.05):
        request.wfile.write(b"v")


def crawling(request: BaseHTTPRequestHandler, ended: Event) -> None:
    """Begin a header, and never end it."""
    request.wfile.write(b"HTTP/1.1 200 OK\r\nX: ")
    while not ended.wait(0.05):
        request.wfile.write(b"x")


def broken(request: BaseHTTPRequestHandler, _: Event) -> None:
    """Close the connection in the middle."""
    begin(request, 1000)
    request.wfile.write(b"v")
    request.close_connection = True


def inflated(size: int) -> Answer:
    """So many zeros, as gzip."""
    return sound(gzip.compress(bytes(size)), Content_Encoding="gzip")


def zipped(data: bytes, *, said: int | None = None, name: str = "a.glb") -> bytes:
    """A .zip archive with a file, which may be said to have another size."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, data)
        if said is not None:
            archive.infolist()[0].file_size = said
    return made.getvalue()


def tarred(data: bytes, *, name: str = "a.glb") -> bytes:
    """A .tar.gz archive with a file."""
    made = io.BytesIO()
    with tarfile.open(fileobj=made, mode="w:gz") as archive:
        info = tarfile.TarInfo(name)
        info.size = len(data)
        archive.addfile(info, io.BytesIO(data))
    return made.getvalue()


@contextmanager
def served(answers: Mapping[str, Answer]) -> Iterator[str]:
    """Serve answers by their paths while the block runs; gives the address."""
    ended = Event()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            answer = answers.get(self.path)
            if answer is None:
                self.send_error(404)
                return
            try:
                answer(self, ended)
            except OSError:  # the other end has had enough
                self.close_connection = True

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        ended.set()
        server.shutdown()
        thread.join()
        server.server_close()
