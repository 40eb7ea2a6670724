"""Stores of objects: in memory, on this machine, and a server that speaks S3."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def s3_server() -> Iterator[None]:
    """A server of moto, which keeps its objects in memory; the environment says where it is, as for any other one."""
    server = pytest.importorskip("moto.server").ThreadedMotoServer("127.0.0.1", port=0)
    server.start()
    host, port = server.get_host_and_port()
    known = {
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
        "AWS_ACCESS_KEY_ID": "nobody",
        "AWS_SECRET_ACCESS_KEY": "nothing",
        "AWS_DEFAULT_REGION": "us-east-1",
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, value in known.items():
            patch.setenv(name, value)
        import s3fs

        s3fs.S3FileSystem.clear_instance_cache()
        s3fs.S3FileSystem().makedirs("made-for-tests", exist_ok=True)
        yield
    server.stop()


S3 = pytest.param("s3", marks=pytest.mark.exhaustive)


@pytest.fixture(params=["memory", "file", S3])
def address(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """An address of each kind, at which nothing is yet."""
    if request.param == "file":
        return f"file://{tmp_path}/place"
    if request.param == "s3":
        request.getfixturevalue("s3_server")
        return f"s3://made-for-tests/{secrets.token_hex(4)}"
    return f"memory://{secrets.token_hex(4)}"
