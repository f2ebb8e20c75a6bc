"""Videos of any size; a failing encoder is an error."""

from __future__ import annotations

from pathlib import Path

import imageio.v2 as imageio
import imageio_ffmpeg
import numpy as np
import pytest

from gensim2.core.errors import WriteError
from gensim2.core.files import replacing
from gensim2.data.video import pixel_format, write_video

PICTURES = np.random.default_rng(0).integers(0, 256, (5, 73, 97, 3)).astype(np.uint8)


@pytest.mark.parametrize("size", [(73, 97), (72, 97), (73, 96), (72, 96), (1, 1)])
@pytest.mark.parametrize("count", [1, 5])
def test_pictures_of_odd_sides_keep_their_size(tmp_path: Path, size: tuple[int, int], count: int) -> None:
    pictures = PICTURES[:count, : size[0], : size[1]]
    write_video(tmp_path / "a.mp4", pictures, 20, exact=True)
    found = imageio.mimread(tmp_path / "a.mp4")
    assert np.shape(found) == pictures.shape
    is_even = size[0] % 2 == size[1] % 2 == 0
    assert pixel_format(*size) == ("yuv420p" if is_even else "yuv444p")


@pytest.mark.parametrize("script", ["cat > /dev/null; exit 1", "cat > /dev/null", "exit 1", "head -c 100 > /dev/null"])
@pytest.mark.parametrize("count", [1, 300])
def test_an_encoder_that_ends_early_is_one_error_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], script: str, count: int
) -> None:
    fake = tmp_path / "ffmpeg"
    fake.write_text(f'#!/bin/sh\ncase "$*" in *rawvideo*) {script};; *) exec "$REAL" "$@";; esac\n')
    fake.chmod(0o755)
    monkeypatch.setenv("REAL", imageio_ffmpeg.get_ffmpeg_exe())
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(fake))
    pictures = np.repeat(PICTURES[:1, :72, :96], count, axis=0)
    for exact in (True, False):
        out = tmp_path / "out" / "a.mp4"
        with pytest.raises(WriteError, match="the video encoder ended early"), replacing(out) as path:
            write_video(path, pictures, 20, exact=exact)
        assert list(out.parent.iterdir()) == []
    assert "FFMPEG" not in capfd.readouterr().err
