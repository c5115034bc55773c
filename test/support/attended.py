# SPDX-License-Identifier: Apache-2.0
"""A supervisor that runs while a test looks at it."""

import threading


def attended(supervisor, work):
    """Run `supervisor` while `work()` looks at it from another thread; then stop it.

    Return its exit code.
    """
    errors = []

    def look():
        try:
            work()
        except BaseException as error:
            errors.append(error)
        finally:
            supervisor.stop()

    thread = threading.Thread(target=look)
    thread.start()
    code = supervisor.run()
    thread.join()
    assert not errors
    return code
