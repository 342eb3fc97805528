"""Decoding meshopt streams; data/README.md says where they come from."""

import hashlib
import json
from base64 import b64decode
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrinklecli.errors import AssetError
from wrinklecli.gltf import meshopt
from wrinklecli.gltf.meshopt import decode

Json = dict[str, Any]

STREAMS: list[Json] = json.loads((Path(__file__).parents[1] / "data" / "streams.json").read_text())
for each in STREAMS:
    each["data"] = b64decode(each["data"])


def decoded(stream: Json, **changes: Any) -> bytes:
    stream = stream | changes
    data = memoryview(stream["data"])
    count, stride = stream["count"], stream["stride"]
    return decode(data, count=count, stride=stride, mode=stream["mode"], filter_name=stream["filter"], where="view")


def title(stream: Json) -> str:
    return "{mode}-{filter}-v{version}-{count}x{stride}".format(**stream)


@pytest.mark.parametrize("stream", [each for each in STREAMS if "sha256" in each], ids=title)
def test_streams_decode_to_the_same_bytes(stream: Json) -> None:
    assert hashlib.sha256(decoded(stream)).hexdigest() == stream["sha256"]


@pytest.mark.parametrize("stream", [each for each in STREAMS if "decoded" in each], ids=title)
def test_filters_are_within_the_unit_that_the_specification_allows(stream: Json) -> None:
    kind = "u" if stream["filter"] == "COLOR" else "i"
    dtype = f"<{kind}{2 if stream['filter'] == 'QUATERNION' else stream['stride'] // 4}"
    found, expected = (np.frombuffer(data, dtype) for data in (decoded(stream), b64decode(stream["decoded"])))
    differences = np.abs(found.astype(int) - expected.astype(int))
    assert differences.max() <= (1 if dtype[-1] == "2" else 0)
    assert np.mean(differences > 0) < 0.01


def test_every_kind_of_stream_is_here() -> None:
    kinds = {(each["mode"], each["filter"], each["version"], each["data"][0]) for each in STREAMS}
    for filter_name in ("NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR"):
        assert {("ATTRIBUTES", filter_name, 0, 0xA0), ("ATTRIBUTES", filter_name, 1, 0xA1)} <= kinds
    assert {("TRIANGLES", "NONE", 0, 0xE1), ("INDICES", "NONE", 0, 0xD1)} <= kinds


def test_the_deltas_that_the_specification_works_out() -> None:
    """The example of appendix A: a group of 4-bit deltas with two escapes."""
    group = bytes.fromhex("175ff0bc77a9210034b5")
    deltas = [-1, -4, -3, 26, -91, 0, -6, 6, -4, -4, 5, -5, 1, -1, 0, 0]
    # Byte 0 of each element has the group, in the header's encoding 2; the others have nothing.
    data = b"\xa0" + b"\x02" + group + bytes(3) + bytes(32)
    found = np.frombuffer(decoded(STREAMS[0], data=data, count=16, stride=4), np.uint8).reshape(16, 4)
    assert (found[:, 0] == np.cumsum(deltas) % 256).all()
    assert not found[:, 1:].any()


@pytest.mark.parametrize("width", [1, 2])
@pytest.mark.parametrize("bits", range(1, 9))
def test_colours_of_any_number_of_bits_have_their_whole_range(bits: int, width: int) -> None:
    """Alpha without its lowest bit, behind a bit that tells how many bits all have; 0 has none."""
    full, half, limit = 2**bits - 1, 2**bits // 2 - 1, 256**width - 1
    white, black, orange = (full, 0, 0, full), (0, 0, 0, full - half), (half, half, 0, full)
    stored = np.array([white, black, orange, (0, 0, 0, 0)]).astype(f"<i{width}")
    opaque = limit if bits > 1 else 0  # a single bit is the one that tells how many there are
    warm = [round(limit * 2 * half / full), round(limit * half / full), 0, opaque]
    assert meshopt._color(stored.view(np.uint8)).tolist() == [[*[limit] * 3, opaque], [0] * 4, warm, [0] * 4]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mode": "POINTS"}, "mode is 'POINTS'"),
        ({"filter": "BLUR"}, "filter is 'BLUR'"),
        ({"stride": 6}, "byteStride 6"),
        ({"stride": 260}, "byteStride 260"),
        ({"filter": "QUATERNION", "stride": 4}, "byteStride 4"),
        ({"mode": "TRIANGLES", "stride": 4, "count": 4}, "count is 4"),
        ({"count": 0}, "count is 0"),
        ({"data": b""}, "malformed"),
        ({"data": b"\xa0"}, "malformed"),
        ({"data": b"\xb0" + bytes(100)}, "version 0 or 1"),
        ({"data": b"\xa0" + bytes(100), "count": 2**26}, "too few"),
        ({"data": b"\xa0" + bytes(100), "stride": 4, "count": 16}, "left over"),
        ({"data": b"\xa1" + b"\xaa" + bytes(23) + b"\x03", "stride": 4, "count": 16}, "channel mode 0x03"),
        ({"mode": "TRIANGLES", "stride": 2, "count": 3, "data": b"\xe1" + b"\x00" + bytes(16)}, "before the first"),
        ({"mode": "TRIANGLES", "stride": 2, "count": 3, "data": b"\xe1" + b"\xff" + bytes(16)}, "within a triangle"),
        ({"mode": "TRIANGLES", "stride": 2, "count": 3, "data": b"\xe1" + b"\xf0" + b"\xf0" * 16}, "table"),
        ({"mode": "INDICES", "stride": 2, "count": 2, "data": b"\xd1" + b"\x00" + bytes(4)}, "1 whole indices"),
        ({"mode": "INDICES", "stride": 4, "count": 1, "data": b"\xd1" + b"\x80" * 5 + b"\1" + bytes(4)}, "five bytes"),
    ],
)
def test_what_is_wrong_is_said(changes: Json, message: str) -> None:
    with pytest.raises(AssetError, match="^view: .*" + message):
        decoded(STREAMS[0], **changes)


@pytest.mark.parametrize("stream", STREAMS[::7], ids=title)
def test_truncated_streams_are_refused(stream: Json) -> None:
    for length in range(0, len(stream["data"]), max(1, len(stream["data"]) // 20)):
        with pytest.raises(AssetError):
            decoded(stream, data=stream["data"][:length])


@given(
    stream=st.sampled_from(STREAMS),
    flips=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1, max_size=8),
    extra=st.integers(-2, 2),
)
def test_damaged_streams_are_decoded_or_refused(stream: Json, flips: list[tuple[float, int]], extra: int) -> None:
    data = bytearray(stream["data"])
    for place, value in flips:
        data[int(place * len(data))] = value
    count = max(1, stream["count"] + 3 * extra)
    with suppress(AssetError):
        assert len(decoded(stream, data=bytes(data), count=count)) == count * stream["stride"]


@given(st.sampled_from([0xA0, 0xA1, 0xE1, 0xD1]), st.binary(max_size=300), st.sampled_from([4, 16]))
def test_noise_is_decoded_or_refused(first: int, noise: bytes, stride: int) -> None:
    mode = {0xE1: "TRIANGLES", 0xD1: "INDICES"}.get(first, "ATTRIBUTES")
    for count in (3, 48, 3000):
        size = stride if mode == "ATTRIBUTES" else 4
        changes = {"data": bytes([first]) + noise, "mode": mode, "stride": size, "count": count}
        with suppress(AssetError):
            assert len(decoded(STREAMS[0], **changes)) == count * size
