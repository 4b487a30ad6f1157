"""Put a diagnosis and its evidence into one self-contained HTML file.

The words are written here, so that they are there without a script; the pictures are drawn in the browser by
the JavaScript beside this file, from two JSON blocks inside the page. A content security policy with the
digests of our own style and script keeps the page from loading anything, and from running what a name may
carry.
"""

import base64
import hashlib
import html
import json
import math
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from clearance.whole_files import write_atomically

# in this order
SCRIPTS = (
    "dom.js", "plot.js", "heat.js", "mechanism.js", "force.js", "better.js", "seen.js", "sensors.js",
    "page.js",
)  # fmt: skip
DIGITS = 8  # of a number in the evidence: log-likelihoods of 1e6 that differ by 0.1 stay apart, half the size

VERDICTS: Mapping[str, str] = {
    "none": "Nothing is missing",
    "physics": "Physics is missing from the model",
    "instrument": "An instrument is at fault",
    "mixed": "Physics is missing and an instrument is at fault",
    "unknown": "Something is missing that no known effect explains",
    "ambiguous": "These sensors cannot tell the causes apart",
    "open": "No verdict was reached",  # an interrupted diagnosis: what was found so far
    "unconfirmed": "Nothing was found, and nothing was confirmed on what was held out",
}


def write_report(path: Path, diagnosis: Mapping[str, Any], evidence: Mapping[str, Any]) -> None:
    """Write the page to ``path``: readers see the old file or the new one.

    Args:
        path: usually ``report.html`` in the folder of the diagnosis.
        diagnosis: the content of ``diagnosis.json``; every key may be missing, None or empty.
        evidence: arrays behind the pictures (lists or NumPy); a picture without its data is left out.

    Raises:
        InputError: if the file cannot be written.
    """
    text = render_report(diagnosis, evidence)
    write_atomically(path, lambda file: file.write_text(text, encoding="utf-8"))


def render_report(diagnosis: Mapping[str, Any], evidence: Mapping[str, Any]) -> str:
    """Return the page as text."""
    found = plain(diagnosis)
    verdict = found.get("verdict") if found.get("verdict") in VERDICTS else "open"
    lost = verdict == "unknown" and (found.get("mismatch") or {}).get("detected") is False
    badge = VERDICTS["unconfirmed" if lost else str(verdict)]
    summary = [str(sentence) for sentence in found.get("summary") or []] or [f"{badge}."]
    style = _part("report.css")
    script = "(() => {\n" + "\n".join(_part(name) for name in SCRIPTS) + "\n})();\n"
    return Template(_part("template.html")).substitute(
        style=style,
        script=script,
        policy=(
            "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:; "
            f"style-src '{_digest(style)}'; script-src '{_digest(script)}'"
        ),
        verdict=verdict,
        badge=html.escape(badge),
        headline=html.escape(summary[0]),
        sentences="\n".join(f"<p>{html.escape(sentence)}</p>" for sentence in summary[1:]),
        warnings=_warnings([str(warning) for warning in found.get("warnings") or []]),
        numbers=html.escape(json.dumps(found, indent=2, ensure_ascii=False)),
        diagnosis=_embedded(found),
        evidence=_embedded(plain(evidence, DIGITS)),
    )


def _part(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _warnings(sentences: list[str]) -> str:
    if not sentences:
        return ""
    items = "".join(f"<li>{html.escape(sentence)}</li>" for sentence in sentences)
    return f'<aside class="warnings" aria-label="Warnings"><h2>Mind this</h2><ul>{items}</ul></aside>'


def _embedded(content: Any) -> str:
    """JSON that no HTML parser takes for markup: what opens or closes a tag or a comment is escaped."""
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def plain(content: Any, digits: int | None = None) -> Any:
    """Plain data for JSON: arrays become lists, NaN and infinity null; floats keep ``digits`` digits."""
    if isinstance(content, Mapping):
        return {str(key): plain(value, digits) for key, value in content.items()}
    if isinstance(content, np.ndarray | np.generic):
        return plain(content.tolist(), digits)
    if isinstance(content, list | tuple):
        return [plain(value, digits) for value in content]
    if isinstance(content, float):
        if not math.isfinite(content):
            return None
        return content if digits is None else float(f"{content:.{digits}g}")
    if content is None or isinstance(content, bool | int | str):
        return content
    return str(content)
