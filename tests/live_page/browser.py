"""A real Chromium without a screen, driven by its DevTools protocol."""

import base64
import json
import shutil
import subprocess
import tempfile
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

from websockets.sync.client import connect

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


class Tab:
    """One page that is open."""

    def __init__(self, socket):
        self._socket, self._number = socket, 0

    def call(self, method, **arguments):
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": arguments}))
        while True:
            said = json.loads(self._socket.recv(timeout=20))
            if said.get("id") == self._number:
                assert "error" not in said, said
                return said["result"]

    def ask(self, expression):
        """The value of an expression in the page."""
        found = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def until(self, expression, patience=20.0):
        """Wait until an expression holds; its value."""
        deadline = time.monotonic() + patience
        while not (found := self.ask(expression)):
            assert time.monotonic() < deadline, f"never came: {expression}; {self.ask('document.body.innerText')}"
            time.sleep(0.05)
        return found

    def key(self, name):
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=name, code=name)

    def click(self, element):
        self.press(*self.place(element))

    def place(self, element):
        """The middle of an element."""
        return self.ask(
            f"(() => {{ const b = document.getElementById('{element}').getBoundingClientRect();"
            " return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )

    def press(self, x, y):
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def picture(self, path, whole=True):
        found = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        Path(path).write_bytes(base64.b64decode(found["data"]))


class Browser:
    """A Chromium of its own."""

    def __init__(self, stack, process, root):
        self._stack, self.process, self._root = stack, process, root
        self._main = self._connected(root)

    def _connected(self, address):
        return Tab(self._stack.enter_context(connect(address, max_size=None, compression=None)))

    def open(self, address):
        """A tab in a window of its own: one in the background draws nothing."""
        target = self._main.call("Target.createTarget", url=address, newWindow=True)["targetId"]
        tab = self._connected(f"{self._root.split('/devtools/')[0]}/devtools/page/{target}")
        tab.call("Runtime.enable")
        return tab


@contextmanager
def browser(width=1280, height=1900):
    """A browser that ends with the context."""
    with tempfile.TemporaryDirectory(prefix="palpate-chromium-", ignore_cleanup_errors=True) as profile:
        command = [CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0"]
        command += [f"--user-data-dir={profile}", f"--window-size={width},{height}", "--no-first-run"]
        command += ["--hide-scrollbars", "about:blank"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        try:
            line = next(line for line in process.stderr if "DevTools listening on" in line)
            with ExitStack() as stack:
                yield Browser(stack, process, line.split()[-1].strip())
        finally:
            process.kill()
            process.wait()
            process.stderr.close()
