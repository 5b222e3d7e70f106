"""Headless Chromium over a pipe: opens a page at a width, and tells what is wrong with how it looks.

CHROME: the program; else chromium, chromium-browser or google-chrome of the PATH.
"""

import base64
import json
import os
import pathlib
import select
import shutil
import subprocess
import tempfile
import time

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage", "--remote-debugging-pipe",
)  # fmt: skip

# Faults of the page as it is laid out now. A box may be wider than its place only where it scrolls by itself.
FAULTS = """(() => {
  const width = document.documentElement.clientWidth, found = [];
  if (document.documentElement.scrollWidth > width) found.push(`the page is ${document.documentElement.scrollWidth} px wide, of ${width}`);
  const scrolls = e => { for (; e; e = e.parentElement) if (['auto', 'scroll'].includes(getComputedStyle(e).overflowX)) return true; return false; };
  for (const e of document.body.querySelectorAll('*')) {
    if (e.closest('svg') && e.tagName !== 'svg') continue;
    const box = e.getBoundingClientRect();
    if (box.width && (box.right > width + 0.5 || box.left < -0.5) && !scrolls(e)) found.push(`${e.tagName} from ${box.left} to ${box.right} px: ${e.textContent.slice(0, 60)}`);
  }
  for (const svg of document.querySelectorAll('svg')) {
    const own = svg.getBoundingClientRect();
    for (const text of svg.querySelectorAll('text')) {
      const box = text.getBoundingClientRect(), size = parseFloat(getComputedStyle(text).fontSize) * text.getScreenCTM().a;
      if (own.width && size < 11) found.push(`text of ${size.toFixed(1)} px: ${text.textContent}`);
      if (own.width && (box.left < own.left - 1 || box.right > own.right + 1 || box.top < own.top - 1 || box.bottom > own.bottom + 1)) found.push(`cut: ${text.textContent}`);
    }
  }
  for (const e of document.querySelectorAll('p, td, th, li, summary, figcaption, h1, h2')) {
    const size = parseFloat(getComputedStyle(e).fontSize);
    if (size < 11) found.push(`text of ${size} px: ${e.textContent.slice(0, 60)}`);
  }
  for (const image of document.images) if (!image.complete || !image.naturalWidth) found.push(`broken picture: ${image.src.slice(0, 60)}`);
  return {faults: found, text: document.body.innerText, texts: document.querySelectorAll('svg text').length};
})()"""


def program():
    """Path of Chromium; none where there is none."""
    return os.environ.get("CHROME") or next(filter(None, map(shutil.which, NAMES)), None)


class Chromium:
    """A browser with one tab, driven by the DevTools protocol over a pipe."""

    def __init__(self, path):
        self.folder = tempfile.TemporaryDirectory(prefix="chromium", ignore_cleanup_errors=True)
        to_browser, self.send = os.pipe()
        self.receive, from_browser = os.pipe()
        # The browser reads descriptor 3 and writes to 4.
        words = 'in=$1 out=$2; shift 2; eval "exec 3<&$in 4>&$out"; exec "$@"'
        command = ["bash", "-c", words, "bash", str(to_browser), str(from_browser), path, *FLAGS, f"--user-data-dir={self.folder.name}", "about:blank"]
        self.child = subprocess.Popen(command, pass_fds=(to_browser, from_browser), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
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

    def look(self, page, width, picture=None):
        """Faults of the page at this width, its folded parts opened at the end, and its text; a screenshot where a path is given."""
        self.events.clear()
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
        self.call("Page.navigate", url=pathlib.Path(page).resolve().as_uri())
        self.wait("Page.loadEventFired")
        if picture:
            self.save(picture)
        looked = self.evaluate(FAULTS)
        self.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
        if picture:
            self.save(pathlib.Path(picture).with_suffix(".all.png"))
        opened = self.evaluate(FAULTS)
        looked["faults"] += opened["faults"] + self.complaints()
        return looked | {"texts": opened["texts"]}

    def complaints(self):
        """Errors of the console, and everything that the page asked for beyond itself."""
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
    """Screenshots of pages: `python chromium.py FOLDER PAGE...`, at 1400 and at 420 px."""
    import sys

    browser, folder = Chromium(program()), pathlib.Path(sys.argv[1])
    for page in sys.argv[2:]:
        name = "_".join(pathlib.Path(page).with_suffix("").parts[-3:]).strip("/")
        for width in (1400, 420):
            print(page, width, *browser.look(page, width, folder / f"{name}_{width}.png")["faults"], sep="\n  ")
    browser.close()


if __name__ == "__main__":
    main()
