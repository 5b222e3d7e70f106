"""Headless Chromium over a pipe: opens a page at a width and lists faults of its layout.

CHROME: path of the browser; by default chromium, chromium-browser or google-chrome on the PATH.

    python tests/support/chromium.py FOLDER PAGE...    # screenshots in both schemes at 1400 and at 420 px
"""

import base64
import json
import os
import pathlib
import select
import shutil
import subprocess
import sys
import tempfile
import time

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage", "--remote-debugging-pipe",
)  # fmt: skip

FAULTS = pathlib.Path(__file__).with_name("page_faults.js").read_text()


def program():
    """Path of Chromium; None if there is none."""
    return os.environ.get("CHROME") or next(filter(None, map(shutil.which, NAMES)), None)


class Chromium:
    """A browser with one tab, driven by the DevTools protocol over a pipe."""

    def __init__(self, path):
        self.folder = tempfile.TemporaryDirectory(prefix="chromium", ignore_cleanup_errors=True)
        to_browser, self.send = os.pipe()
        self.receive, from_browser = os.pipe()
        # --remote-debugging-pipe reads from file descriptor 3 and writes to 4.
        words = 'in=$1 out=$2; shift 2; eval "exec 3<&$in 4>&$out"; exec "$@"'
        browser = [path, *FLAGS, f"--user-data-dir={self.folder.name}", "about:blank"]
        command = ["bash", "-c", words, "bash", str(to_browser), str(from_browser), *browser]
        null = subprocess.DEVNULL
        self.child = subprocess.Popen(command, pass_fds=(to_browser, from_browser), stdin=null, stdout=null, stderr=null)
        os.close(to_browser)
        os.close(from_browser)
        self.number, self.rest, self.events, self.session = 0, b"", [], None
        target = next(t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page")
        self.session = self.call("Target.attachToTarget", targetId=target["targetId"], flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def message(self, deadline):
        while b"\0" not in self.rest:
            ready, _, _ = select.select([self.receive], [], [], max(0, deadline - time.monotonic()))
            assert ready, "Chromium does not answer"
            data = os.read(self.receive, 1 << 20)
            assert data, "Chromium has ended"
            self.rest += data
        message, self.rest = self.rest.split(b"\0", 1)
        return json.loads(message)

    def call(self, method, **parameters):
        self.number += 1
        request = {"id": self.number, "method": method, "params": parameters} | ({"sessionId": self.session} if self.session else {})
        os.write(self.send, json.dumps(request).encode() + b"\0")
        deadline = time.monotonic() + 60
        while True:
            message = self.message(deadline)
            if message.get("id") == self.number:
                assert "error" not in message, f"{method}: {message['error']}"
                return message["result"]
            self.events.append(message)

    def wait(self, event):
        deadline = time.monotonic() + 60
        while all(e.get("method") != event for e in self.events):
            self.events.append(self.message(deadline))

    def evaluate(self, expression):
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def prefer(self, scheme):
        """Opens pages from now on for a reader who prefers the `light` or the `dark` scheme."""
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def open(self, page, width=1400, scripts=True):
        """Opens a page at a width, with or without its scripts."""
        self.events.clear()
        self.call("Emulation.setScriptExecutionDisabled", value=not scripts)
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
        self.call("Page.navigate", url=pathlib.Path(page).resolve().as_uri())
        self.wait("Page.loadEventFired")

    def faults_of(self, page, width, picture=None):
        """Opens a page at a width, folded and unfolded; returns its faults, its text and the number of texts in pictures.

        `picture`: path of a screenshot.
        """
        self.open(page, width)
        if picture:
            self.save(picture)
        found = self.evaluate(FAULTS)
        self.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
        if picture:
            self.save(pathlib.Path(picture).with_suffix(".all.png"))
        opened = self.evaluate(FAULTS)
        found["faults"] += opened["faults"] + self.complaints()
        return found | {"texts": opened["texts"]}

    def complaints(self):
        """Errors of the console, and requests of the page beyond itself."""
        said = []
        for event in self.events:
            method, told = event.get("method"), event.get("params", {})
            if method == "Runtime.exceptionThrown":
                said.append(f"exception: {told['exceptionDetails'].get('text')}")
            elif method == "Runtime.consoleAPICalled" and told["type"] in ("error", "warning", "assert"):
                said.append(f"console: {told['args']}")
            elif method == "Log.entryAdded" and told["entry"]["level"] in ("error", "warning"):
                said.append(f"log: {told['entry']['text']}")
            elif method == "Network.requestWillBeSent" and not told["request"]["url"].startswith(("file:", "data:")):
                said.append(f"asks for {told['request']['url']}")
        return said

    def save(self, path):
        height = self.evaluate("document.documentElement.scrollHeight")
        width = self.evaluate("innerWidth")
        clip = {"x": 0, "y": 0, "width": width, "height": min(height, 12_000), "scale": 1}
        shot = self.call("Page.captureScreenshot", captureBeyondViewport=True, clip=clip)
        pathlib.Path(path).write_bytes(base64.b64decode(shot["data"]))

    def close(self):
        self.child.terminate()
        try:
            self.child.wait(10)
        except subprocess.TimeoutExpired:
            self.child.kill()
            self.child.wait()
        os.close(self.send)
        os.close(self.receive)
        self.folder.cleanup()


def main():
    """Saves screenshots of the pages on the command line and prints their faults."""
    browser, folder = Chromium(program()), pathlib.Path(sys.argv[1])
    for scheme in ("light", "dark"):
        browser.prefer(scheme)
        for page in sys.argv[2:]:
            name = "_".join(pathlib.Path(page).with_suffix("").parts[-3:]).strip("/")
            for width in (1400, 420):
                found = browser.faults_of(page, width, folder / f"{name}_{scheme}_{width}.png")
                print(page, scheme, width, *found["faults"], sep="\n  ")
    browser.close()


if __name__ == "__main__":
    main()
