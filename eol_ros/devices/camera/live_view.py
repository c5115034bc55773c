# SPDX-License-Identifier: Apache-2.0
"""A picture for a browser while somebody turns the lens: JPEG after JPEG, on this machine alone."""

import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np

from eol_ros.devices.files import picture_file
from eol_ros.errors import UsageError

QUALITY = 85
PAGE = b"""<!doctype html><html lang="en"><meta charset="utf-8"><title>eol camera</title>
<style>body{margin:0;background:#111}img{display:block;width:100vw;height:100vh;object-fit:contain}
</style><img src="/stream" alt="the camera's image, with the number to turn the lens by">
"""


class LiveView:
    """Serves what `show` was given last to any number of browsers at http://127.0.0.1:PORT."""

    def __init__(self, port: int):
        self._jpeg, self._number = b'', 0
        self._new = threading.Condition()
        self._closed = False
        view = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                if self.path == '/':
                    self.send_response(200)
                    self.send_header('Content-Type', 'text/html; charset=utf-8')
                    self.send_header('Content-Length', str(len(PAGE)))
                    self.end_headers()
                    self.wfile.write(PAGE)
                elif self.path == '/stream':
                    self.send_response(200)
                    kind = 'multipart/x-mixed-replace; boundary=image'
                    self.send_header('Content-Type', kind)
                    self.end_headers()
                    view._stream(self)
                else:
                    self.send_error(404)

            def log_message(self, format: str, *args: object) -> None:
                pass

        try:
            self._server = ThreadingHTTPServer(('127.0.0.1', port), Handler)
        except (OSError, OverflowError) as error:
            raise UsageError(f'--view {port}: cannot serve there ({error})') from None
        self._server.daemon_threads = True
        self.url = f'http://127.0.0.1:{self._server.server_address[1]}/'
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def show(self, image: np.ndarray, words: str) -> None:
        """Show an image (h, w) uint8 with `words` on it."""
        shown = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        size = image.shape[1] / 1000
        place, width = (round(20 * size), round(45 * size)), max(round(2 * size), 1)
        picture_file.write_text(shown, words, place, (80, 255, 80), size, width)
        done, jpeg = cv2.imencode('.jpg', shown, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        if done:
            with self._new:
                self._jpeg, self._number = jpeg.tobytes(), self._number + 1
                self._new.notify_all()

    def _stream(self, handler: BaseHTTPRequestHandler) -> None:
        sent = 0
        while not self._closed:
            with self._new:
                while self._number == sent and not self._closed:
                    self._new.wait()
                jpeg, sent = self._jpeg, self._number
            head = f'--image\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n'
            try:
                handler.wfile.write(head.encode() + jpeg + b'\r\n')
            except OSError:
                return

    def close(self) -> None:
        """Stop serving."""
        with self._new:
            self._closed = True
            self._new.notify_all()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
