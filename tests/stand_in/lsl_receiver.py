"""Receives the two streams of `farreach bridge lsl` with pylsl, and prints what came as JSON.

    lsl_receiver.py RIG_NAME SAMPLES MARKERS

Prints `ready` once both streams are open, and a line of JSON once so many samples and markers are
there: the streams' descriptions, samples as [time, values] and markers as [time, text]. Times are
those of the sender's clock (s).
"""

import json
import sys
import time

import pylsl

LIMIT_S = 60


def opened(name):
    found = pylsl.resolve_byprop("name", name, timeout=LIMIT_S)
    if len(found) != 1:
        sys.exit(f"{name}: expected one stream, found {len(found)}")
    inlet = pylsl.StreamInlet(found[0], max_buflen=60)
    inlet.open_stream(timeout=LIMIT_S)
    return inlet


def described(inlet):
    info = inlet.info(timeout=LIMIT_S)
    channels = []
    channel = info.desc().child("channels").child("channel")
    while not channel.empty():
        channels.append([channel.child_value("label"), channel.child_value("unit")])
        channel = channel.next_sibling("channel")
    return {
        "type": info.type(),
        "rate_hz": info.nominal_srate(),
        "source_id": info.source_id(),
        "count": info.channel_count(),
        "channels": channels,
        "clock_offset_s": info.desc().child_value("clock_offset_s"),
        "clock_uncertainty_s": info.desc().child_value("clock_uncertainty_s"),
        "correction_s": inlet.time_correction(timeout=LIMIT_S),
    }


def main():
    rig, count, marks = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    inlets = [opened(f"{rig}.{what}") for what in ("sample", "markers")]
    result = {"sample": described(inlets[0]), "markers": described(inlets[1])}
    print("ready", flush=True)
    samples, markers = [], []
    until = time.monotonic() + LIMIT_S
    while len(samples) < count or len(markers) < marks:
        if time.monotonic() > until:
            sys.exit(f"{len(samples)} samples and {len(markers)} markers in {LIMIT_S} s")
        for inlet, into in zip(inlets, (samples, markers)):
            values, times = inlet.pull_chunk(timeout=0.05, max_samples=4096)
            into.extend([at, value] for at, value in zip(times, values))
    result["samples"] = samples
    result["marks"] = [[at, value[0]] for at, value in markers]
    print(json.dumps(result), flush=True)


if __name__ == "__main__":
    main()
