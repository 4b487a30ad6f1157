"""Events of a diagnosis for TensorBoard: what was tried, how likely it is, its parameters, and pictures."""

import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.event_file_writer import EventFileWriter


def write_events(
    folder: Path,
    diagnosis: Mapping[str, Any],
    evidence: Mapping[str, Any],
    tried: Sequence[Mapping[str, Any]],
) -> None:
    """Write an events file into a folder.

    Tags are ``misfit/NAME`` and ``clearance/NAME`` of everything that was fitted, in the order in which it
    was; ``log_likelihood_gain/NAME`` of every explanation, in the order of the ranking; ``parameter/NAME``
    with ``/low`` and ``/high`` of what was found; and pictures.

    Args:
        folder: of the diagnosis.
        diagnosis: the content of ``diagnosis.json``.
        evidence: as of ``write_report``.
        tried: name, misfit and clearance [m] of everything that was fitted.
    """
    events = EventFileWriter(str(folder))  # of TensorBoard alone: torch takes seconds to be imported
    for step, value in _scalars(diagnosis, evidence, tried):
        events.add_event(Event(wall_time=time.time(), step=step, summary=Summary(value=[value])))
    for tag, (encoded, width, height) in _pictures(evidence):
        image = Summary.Image(height=height, width=width, colorspace=3, encoded_image_string=encoded)
        picture = Summary.Value(tag=tag, image=image)
        events.add_event(Event(wall_time=time.time(), step=0, summary=Summary(value=[picture])))
    events.close()


def _scalars(
    diagnosis: Mapping[str, Any], evidence: Mapping[str, Any], tried: Sequence[Mapping[str, Any]]
) -> Iterator[tuple[int, Summary.Value]]:
    for step, row in enumerate(tried):
        yield step, Summary.Value(tag=f"misfit/{row['name']}", simple_value=row["misfit"])
        yield step, Summary.Value(tag=f"clearance/{row['name']}", simple_value=row["clearance_m"])
    for step, row in enumerate(evidence.get("ranking") or []):
        gain = row["log_likelihood_gain"]
        if gain is not None:  # beside a path that ended in no number
            yield step, Summary.Value(tag=f"log_likelihood_gain/{row['name']}", simple_value=gain)
    for effect in diagnosis.get("effects") or []:
        whose = "/".join(filter(None, (effect["name"], effect.get("channel"))))
        for name, number in effect["parameters"].items():
            for end, part in (("value", ""), ("low", "/low"), ("high", "/high")):
                if number[end] is not None:  # nobody knows it
                    yield 0, Summary.Value(tag=f"parameter/{whose}/{name}{part}", simple_value=number[end])


def _pictures(evidence: Mapping[str, Any]) -> Iterator[tuple[str, tuple[bytes, int, int]]]:
    # here, as it takes a second to be imported, and a diagnosis begins with less
    from clearance.diagnosis.report.pictures import as_png, beside_the_recording, ranked, where_it_shows

    drawn = {
        "where": where_it_shows(evidence.get("where") or {}),
        "what": ranked(evidence.get("ranking") or []),
        "how_much_better": beside_the_recording(evidence.get("overlays") or []),
    }
    yield from ((tag, as_png(figure)) for tag, figure in drawn.items() if figure is not None)
