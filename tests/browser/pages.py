"""The command line, and pages of it in a headless Chromium."""

import io
import json
import os
import shutil
import subprocess
import tempfile
import time
import unittest
from pathlib import Path

import numpy as np
from PIL import Image

ROOT = Path(__file__).parents[2]
CFREG = ROOT / "target/debug/cfreg"
DATA = Path(os.environ.get("CFREG_DATA", ROOT / "../shared/data"))
CHROMIUM, DRIVER = "/usr/bin/chromium", "/usr/bin/chromedriver"

try:
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service
except ImportError:
    webdriver = None


def needed():
    """Skips where there is no browser, saying so."""
    for path in (CHROMIUM, DRIVER):
        if not Path(path).exists():
            raise unittest.SkipTest(f"{path} is not there: apt-get install chromium chromium-driver")
    if webdriver is None:
        raise unittest.SkipTest("selenium is not installed: tests/browser/requirements.txt")


def run(folder, *words, codes=(0,)):
    """cfreg with these words, in this folder."""
    done = subprocess.run([CFREG, *words], cwd=folder, capture_output=True, text=True, timeout=100)
    assert done.returncode in codes, f"{words}: {done.returncode} {done.stderr}"
    return done


class Folder:
    """A folder for pages that goes when the tests are done."""

    def __init__(self):
        self.path = Path(tempfile.mkdtemp(prefix="cfreg-pages-"))

    def remove(self):
        shutil.rmtree(self.path, ignore_errors=True)

    def scans(self):
        """Two scans that share most, the source turned: real ones where they are there."""
        first, second = (DATA / f"stanford_bunny/{name}.ply" for name in ("bun000", "bun045"))
        if not first.exists():
            run(self.path, "demo", "--write", "pair")
            return "pair/source.pcd", "pair/target.pcd"
        turned = "0.36 0.48 -0.8 0.1\n-0.8 0.6 0 0.05\n0.48 0.64 0.6 -0.08\n0 0 0 1\n"
        (self.path / "turned.txt").write_text(turned)
        run(self.path, "convert", str(first), "source.ply", "--transform", "turned.txt")
        return "source.ply", str(second)


class Browser:
    """A headless Chromium that draws in software, with WebGL or without."""

    def __init__(self, webgl=True):
        options = webdriver.ChromeOptions()
        options.binary_location = CHROMIUM
        self.profile = tempfile.mkdtemp(prefix="cfreg-browser-")
        drawing = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        for option in [
            "--headless=new",
            "--no-sandbox",
            "--disable-quic",
            "--no-first-run",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            "--disable-dev-shm-usage",
            f"--user-data-dir={self.profile}",
            *(drawing if webgl else ["--disable-3d-apis"]),
        ]:
            options.add_argument(option)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=Service(DRIVER))
        self.size(1200, 900)

    def size(self, width, height, density=1):
        metrics = {"width": width, "height": height, "deviceScaleFactor": density, "mobile": width < 500}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def prefer(self, **features):
        media = [{"name": name.replace("_", "-"), "value": value} for name, value in features.items()]
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": media})

    def open(self, page, live=True):
        self.logs()
        self.driver.get(Path(page).as_uri())
        if live:
            self.until("document.documentElement.dataset.ready === 'yes'")

    def script(self, text):
        return self.driver.execute_script(f"return {text}")

    def until(self, condition, seconds=15):
        end = time.monotonic() + seconds
        while not self.script(condition):
            if time.monotonic() > end:
                raise AssertionError(f"never: {condition}; {self.logs()}")
            time.sleep(0.05)

    def press(self, keys):
        self.driver.find_element("tag name", "body").send_keys(keys)

    def click(self, selector):
        self.script(f"document.querySelector({json.dumps(selector)}).click()")

    def place(self, x, y, selector="#canvas"):
        """Where on the page a place of an element is: shares of its width and height."""
        box = self.script(f"document.querySelector({json.dumps(selector)}).getBoundingClientRect().toJSON()")
        return {"x": box["left"] + x * box["width"], "y": box["top"] + y * box["height"]}

    def mouse(self, *places, button="left", clicks=1, modifiers=0):
        """Presses at the first place, moves along the others, and lets go."""
        at = [self.place(*place) for place in places]
        send = lambda kind, place, **more: self.driver.execute_cdp_cmd(
            "Input.dispatchMouseEvent", {"type": kind, **place, "button": button, "modifiers": modifiers, **more}
        )
        for count in range(1, clicks + 1):
            send("mousePressed", at[0], clickCount=count)
            for place in at[1:]:
                send("mouseMoved", place, buttons={"left": 1, "right": 2, "middle": 4}[button])
            send("mouseReleased", at[-1], clickCount=count)

    def wheel(self, x, y, turned):
        event = {"type": "mouseWheel", **self.place(x, y), "deltaX": 0, "deltaY": turned}
        self.driver.execute_cdp_cmd("Input.dispatchMouseEvent", event)

    def fingers(self, *moments):
        """Fingers on a touch screen: at each moment the places of all."""
        for k, places in enumerate(moments):
            touches = [{**self.place(*place), "id": finger} for finger, place in enumerate(places)]
            kind = "touchMove" if k else "touchStart"
            self.driver.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touches})
        self.driver.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    def pixels(self, selector="#canvas"):
        """What is on the screen there, once it has come to rest: (height, width, 3)."""
        element = self.driver.find_element("css selector", selector)
        shot = lambda: np.asarray(Image.open(io.BytesIO(element.screenshot_as_png)).convert("RGB"), dtype=int)
        before = shot()
        for _ in range(60):
            # Slow machines draw all points only a while after the last movement.
            time.sleep(0.25)
            now = shot()
            if before.shape == now.shape and (before == now).all():
                return now
            before = now
        raise AssertionError("the view does not come to rest")

    def logs(self):
        """Complaints in the console, and what was asked for over the network."""
        console = [entry["message"] for entry in self.driver.get_log("browser")]
        asked = []
        for entry in self.driver.get_log("performance"):
            message = json.loads(entry["message"])["message"]
            if message["method"] == "Network.requestWillBeSent":
                asked.append(message["params"]["request"]["url"])
        return console, [url for url in asked if not url.startswith(("file:", "data:"))]

    def quit(self):
        self.driver.quit()
        shutil.rmtree(self.profile, ignore_errors=True)
