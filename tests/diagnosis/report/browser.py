"""A real headless browser, driven by the DevTools protocol over two pipes: the standard library is enough."""

import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
import time
from contextlib import suppress
from pathlib import Path

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


def find_browser():
    """Return the path of a browser of the Chromium family, None where there is none."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


def _as_three_and_four(commands, answers):
    """In the child: the ends of the pipes where --remote-debugging-pipe looks for them."""
    high = [fcntl.fcntl(end, fcntl.F_DUPFD, 20) for end in (commands, answers)]
    os.dup2(high[0], 3)
    os.dup2(high[1], 4)


class Browser:
    """One browser process with one page; what the page complains about collects in ``complaints``."""

    def __init__(self, program, folder, patience=40.0):
        self.patience, self.complaints, self.requests = patience, [], []
        self._number, self._pending, self._events = 0, b"", []
        commands_out, self._commands = os.pipe()
        self._answers, answers_in = os.pipe()
        self._process = subprocess.Popen(
            [
                program,
                "--headless=new",
                "--no-sandbox",
                "--disable-gpu",
                "--disable-dev-shm-usage",
                "--disable-extensions",
                "--no-first-run",
                "--disable-background-networking",
                "--disable-component-update",
                "--host-resolver-rules=MAP * ~NOTFOUND",
                "--remote-debugging-pipe",
                f"--user-data-dir={folder}",
                "about:blank",
            ],
            pass_fds=(3, 4),
            preexec_fn=lambda: _as_three_and_four(commands_out, answers_in),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "HOME": str(folder)},
        )
        os.close(commands_out)
        os.close(answers_in)
        target = self.call("Target.createTarget", {"url": "about:blank"}, session=None)["targetId"]
        attach = {"targetId": target, "flatten": True}
        self._session = self.call("Target.attachToTarget", attach, session=None)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        offline = {"offline": True, "latency": 0, "downloadThroughput": 0, "uploadThroughput": 0}
        self.call("Network.emulateNetworkConditions", offline)

    def close(self):
        """End the process."""
        with suppress(OSError, TimeoutError):
            self.call("Browser.close", session=None)
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._commands)
        os.close(self._answers)

    def call(self, method, parameters=None, session=True):
        """Send one command and return its result."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters or {}}
        if session:
            message["sessionId"] = self._session
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        answer = self._until(lambda found: found.get("id") == message["id"])
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']}")
        return answer["result"]

    def open(self, page: Path, width=1280, height=900, dark=False, touch=False, script=True, wait=True):
        """Show a file and wait until its pictures are drawn."""
        self.complaints.clear()
        self.requests.clear()
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": touch}
        self.call("Emulation.setDeviceMetricsOverride", size)
        self.call("Emulation.setTouchEmulationEnabled", {"enabled": touch})
        self.call("Emulation.setScriptExecutionDisabled", {"value": not script})
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.call("Emulation.setEmulatedMedia", {"features": scheme})
        self._events.clear()
        self.call("Page.navigate", {"url": page.resolve().as_uri()})
        self._until(lambda found: found.get("method") == "Page.loadEventFired", self._events)
        if script and wait:
            self.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def run(self, script):
        """Evaluate JavaScript in the page; the value comes back as plain data."""
        ask = {"expression": script, "returnByValue": True, "awaitPromise": True}
        answer = self.call("Runtime.evaluate", ask)
        if "exceptionDetails" in answer:
            raise RuntimeError(str(answer["exceptionDetails"]))
        return answer["result"].get("value")

    def every(self, selector, expression):
        """Evaluate an expression in ``one`` for every element of a selector."""
        return self.run(
            f"[...document.querySelectorAll({json.dumps(selector)})].map((one) => ({expression}))"
        )

    def put(self, selector, value, event="input"):
        """Set the value of an input as a hand would."""
        self.run(
            f"(() => {{ const one = document.querySelector({json.dumps(selector)});"
            f"one.value = {json.dumps(value)}; one.dispatchEvent(new Event({json.dumps(event)})); }})()"
        )

    def press(self, key):
        """Press and release one key."""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", {"type": kind, "key": key, "code": key})

    def mouse(self, kind, x, y, button="none"):
        """Move, press or release the mouse at a point of the window."""
        event = {"type": kind, "x": x, "y": y, "button": button, "clickCount": int(button != "none")}
        self.call("Input.dispatchMouseEvent", event)

    def picture(self, path: Path, whole=True):
        """Save a screenshot, of the whole page unless told otherwise."""
        answer = self.call("Page.captureScreenshot", {"format": "png", "captureBeyondViewport": whole})
        path.write_bytes(base64.b64decode(answer["data"]))

    def pdf(self, path: Path):
        """Save the page as it prints."""
        answer = self.call("Page.printToPDF", {"printBackground": True, "preferCSSPageSize": True})
        path.write_bytes(base64.b64decode(answer["data"]))

    def _until(self, wanted, seen=()):
        for message in seen:
            if wanted(message):
                return message
        end = time.monotonic() + self.patience
        while True:
            while b"\0" in self._pending:
                raw, self._pending = self._pending.split(b"\0", 1)
                message = json.loads(raw)
                self._note(message)
                if wanted(message):
                    return message
            ready, _, _ = select.select([self._answers], [], [], max(0.0, end - time.monotonic()))
            if not ready:
                raise TimeoutError("the browser does not answer")
            chunk = os.read(self._answers, 1 << 20)
            if not chunk:
                raise OSError("the browser has ended")
            self._pending += chunk

    def _note(self, message):
        method, told = message.get("method"), message.get("params", {})
        self._events.append({"method": method})
        if method == "Runtime.exceptionThrown":
            details = told["exceptionDetails"]
            self.complaints.append(details.get("exception", {}).get("description", details["text"]))
        elif method == "Runtime.consoleAPICalled" and told["type"] in ("error", "warning", "assert"):
            self.complaints.append(" ".join(str(part.get("value")) for part in told["args"]))
        elif method == "Log.entryAdded" and told["entry"]["level"] in ("error", "warning"):
            self.complaints.append(f"{told['entry']['text']} {told['entry'].get('url', '')}")
        elif method == "Page.javascriptDialogOpening":
            self.complaints.append(f"dialog: {told['message']}")
            self._number += 1
            close = {"id": self._number, "method": "Page.handleJavaScriptDialog",
                     "params": {"accept": True}, "sessionId": self._session}  # fmt: skip
            os.write(self._commands, json.dumps(close).encode() + b"\0")
        elif method == "Network.requestWillBeSent":
            self.requests.append(told["request"]["url"])
