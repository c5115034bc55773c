# SPDX-License-Identifier: Apache-2.0
"""Whether a file is an image that browsers show, by its content and not by its name."""

import io
import warnings

from PIL import Image, PngImagePlugin, UnidentifiedImageError

SHOWN = ('JPEG', 'MPO', 'PNG', 'WEBP', 'GIF', 'AVIF', 'BMP')  # MPO: several JPEG in one file
HEIC = b'ftypheic', b'ftypheix', b'ftypheim', b'ftypmif1', b'ftypmsf1'
PngImagePlugin.MAX_TEXT_CHUNK = PngImagePlugin.MAX_TEXT_MEMORY  # programs keep projects in them
ROOM = 300e6  # bytes of pixels, beside twice the size of the file


def fault(data: bytes) -> str:
    """Return why browsers would not show an image whole, or an empty string."""
    if not data.strip(b'\0'):
        return 'only zero bytes, as a power cut leaves' if data else 'empty'
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # of large images and odd metadata
            with Image.open(io.BytesIO(data)) as image:
                image.verify()  # the checksums of PNG, up to its end
            with Image.open(io.BytesIO(data)) as image:
                if image.format not in SHOWN:
                    return f'not an image that browsers show ({image.format})'
                width, height = image.size
                image.draft('RGB', (1, 1))  # JPEG is decoded at an eighth of its size
                if 4 * image.size[0] * image.size[1] > 2 * len(data) + ROOM:
                    return f'too large: {width} x {height} pixels'
                image.load()
    except (UnidentifiedImageError, Image.DecompressionBombError) as error:
        if isinstance(error, Image.DecompressionBombError):
            return 'too large: hundreds of megapixels'
        return _of_head(data[:16])
    except (OSError, SyntaxError, EOFError, ValueError, IndexError) as error:
        return f'cut off before its end, or damaged ({error})'
    return ''


def _of_head(head: bytes) -> str:
    """Return what is wrong with a file that no decoder takes, by its first bytes."""
    accepts = {k: Image.OPEN[k][1] for k in SHOWN if k in Image.OPEN}
    if kind := next((k for k, fits in accepts.items() if fits and fits(head) is True), ''):
        return f'cut off before its end, damaged, or of a rare kind ({kind})'
    if head[4:12] in HEIC:
        return 'not an image that browsers show (HEIC); export it as JPEG'
    return f'not an image that is known (it begins with {head[:12]!r})'
