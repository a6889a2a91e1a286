"""Compares PySINDy and SysIdentPy with `farreach identify`: same records, same held-back rows, same
machine, one thread each.

Called by run.sh. The result of each method on each case is stored in a file below the work
directory as soon as it is available; a second run skips the results that exist. Writes peers.json,
prints the tables and writes them to peers.md.
"""

import argparse
import datetime
import importlib.metadata
import json
import os
import platform
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import data
import one_mass
import transmission

ROOT = Path(__file__).resolve().parents[2]
# The first three listed cases, and the first of each other set.
CASES = [
    "listed-001",
    "listed-002",
    "listed-003",
    "clean-001",
    "unlisted-001",
    "pairs-001",
    "emps",
    "silverbox",
]
MEASURED = {
    "emps": ("emps_train.csv", "emps.toml"),
    "silverbox": ("silverbox_multisine.csv", "silverbox.toml"),
}
PACKAGES = ["pysindy", "sysidentpy", "numpy", "scipy", "scikit-learn"]
METHODS = ["farreach", "pysindy", "sysidentpy", "sysidentpy, told"]


def tell(text):
    print(text, file=sys.stderr, flush=True)


def kept(path, make):
    """Returns the result stored in a file; computes and stores it if the file does not exist."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        load = os.getloadavg()[0]
        result = make()
        result.setdefault("load_average", [round(load, 1), round(os.getloadavg()[0], 1)])
        path.with_suffix(".part").write_text(json.dumps(result, indent=1), encoding="utf-8")
        path.with_suffix(".part").rename(path)
    return json.loads(path.read_text(encoding="utf-8"))


def processor_seconds():
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def timed(function):
    """Its result with wall-clock and processor time: the machine may be shared."""
    before = processor_seconds()
    result = function()
    return result | {"processor_seconds": processor_seconds() - before}


def identify(args, rig, records, json_file):
    """Runs farreach; returns its JSON output and the time that it took."""
    command = [
        args.farreach,
        "identify",
        "--rig",
        ROOT / "launch" / "rigs" / rig,
        *records,
        "--jobs",
        "1",
        "--seed",
        "1",
    ]
    began = time.perf_counter()
    done = subprocess.run(
        [*map(str, command), "--json", str(json_file)], capture_output=True, text=True
    )
    if done.returncode != 0:
        raise SystemExit(
            f"{' '.join(map(str, command))}\nended with {done.returncode}: {done.stderr.strip()}"
        )
    return {
        "seconds": time.perf_counter() - began,
        "identified": json.loads(json_file.read_text(encoding="utf-8")),
    }


def named(identified):
    """The verdict of farreach in a few words."""
    effects = ["{id}@{site}".format(**effect) for effect in identified["effects"]]
    rivals = ["{id}@{site}".format(**rival) for rival in identified["ambiguous_with"]]
    text = " + ".join(effects) or {
        "none": "nothing is missing",
        "unlisted": "something without a name",
    }.get(identified["verdict"], identified["verdict"])
    if rivals:
        text += " (or " + ", ".join(rivals) + ")"
    if identified["remains"] and effects:
        text += " + something without a name"
    unlisted = identified.get("unlisted")
    if unlisted:
        text += f" (at the {unlisted['site']}, over {unlisted['depends_on']})"
    return text


def parameters_of(identified):
    fitted = [p for p in identified["parameters"] if p["identifiable"]]
    return len(fitted) + sum(len(effect["parameters"]) for effect in identified["effects"])


# --- transmissions


def run_ahead(args, folder, json_file, roles):
    """Errors of farreach's model 12.5 ms ahead and over the whole record; the observer is chosen on
    the select records, as for PySINDy."""
    found = {}
    for role in ("select", "report"):
        done = subprocess.run(
            [
                args.ahead,
                "--rig",
                str(ROOT / "launch/rigs/hydrostatic.toml"),
                "--identified",
                str(json_file),
                "--observer",
                ",".join(f"{w:g}" for w in transmission.OBSERVERS_RAD_S),
                *[str(folder / record.name) for record in roles[role]],
            ],
            capture_output=True,
            text=True,
        )
        if done.returncode != 0:
            raise SystemExit(f"{args.ahead}: {done.stderr.strip()}")
        found[role] = json.loads(done.stdout)

    def pooled(role, of):
        parts = [of(record) for record in found[role]["records"]]
        if any(part is None for part in parts):
            return None
        count = sum(part["count"] for part in parts)
        return {
            k: 1e3 * float(np.sqrt(sum(p[k] for p in parts) / count)) for k in ("master", "slave")
        }

    observers = list(found["select"]["records"][0]["ahead"])
    best = min(
        observers, key=lambda w: transmission.score(pooled("select", lambda r: r["ahead"][w]))
    )
    return {
        "ahead_mrad": pooled("report", lambda r: r["ahead"][best]),
        "free_mrad": pooled("report", lambda r: r["free"]),
        "observer_rad_s": float(best),
        "left_out": found["report"]["left_out"],
    }


def blind_case(args, name):
    folder, work = Path(args.cases) / name, Path(args.work) / name
    files = sorted(folder.glob("record-*.csv"))
    if not files:
        raise SystemExit(
            f"{folder}: no record-*.csv; make cases with: cargo run --release -p blind_cases --bin"
            " generate -- --help"
        )
    work.mkdir(parents=True, exist_ok=True)
    tell(f"=== {name}")
    json_file = work / "identify.json"
    own = kept(
        work / "farreach.json",
        lambda: timed(lambda: identify(args, "hydrostatic.toml", files, json_file)),
    )
    identified = own["identified"]
    json_file.write_text(json.dumps(identified), encoding="utf-8")
    roles = data.whole_records(identified, [data.transmission(file) for file in files])
    error = identified["error"]
    innovation = {
        when: {"master": 1e3 * error["master_rad"][when], "slave": 1e3 * error["slave_rad"][when]}
        for when in ("before", "after")
    }
    floor = [error[channel]["floor"] for channel in ("master_rad", "slave_rad")]
    farreach = {
        "innovation_mrad": innovation["after"],
        "innovation_before_mrad": innovation["before"],
        "floor_mrad": (
            None if None in floor else {"master": 1e3 * floor[0], "slave": 1e3 * floor[1]}
        ),
        "terms": parameters_of(identified),
        "model": [named(identified)],
        "seconds": own["seconds"],
        "processor_seconds": own["processor_seconds"],
        "load_average": own["load_average"],
        **kept(work / "ahead.json", lambda: run_ahead(args, folder, json_file, roles)),
    }
    peers = {
        "sysidentpy": kept(
            work / "sysidentpy.json", lambda: timed(lambda: transmission.run_narmax(roles, tell))
        ),
        "pysindy": kept(
            work / "pysindy.json", lambda: timed(lambda: transmission.run_sindy(roles, tell))
        ),
    }
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    return {
        "case": name,
        "missing": [f"{effect['id']}@{effect['site']}" for effect in truth["effects"]],
        "records": {role: [record.name for record in records] for role, records in roles.items()},
        "constant_speed": {"ahead_mrad": transmission.constant_speed(roles["report"])},
        "farreach": farreach,
        **peers,
    }


# --- records measured by other groups


def measured_case(args, name):
    csv, rig = MEASURED[name]
    path, work = Path(args.data) / csv, Path(args.work) / name
    if not path.exists():
        tell(
            f"=== {name}: SKIPPED, {path} is absent (a public benchmark; it is not part of this"
            " repository)"
        )
        return None
    work.mkdir(parents=True, exist_ok=True)
    tell(f"=== {name}")
    own = kept(
        work / "farreach.json",
        lambda: timed(lambda: identify(args, rig, [path], work / "identify.json")),
    )
    identified = own["identified"]
    channel, error = next(iter(identified["error"].items()))
    if name == "emps":
        record = one_mass.Emps(path, identified)
        own_error, before = error["after_percent"], error["before_percent"]
        runs = {
            "pysindy": lambda: one_mass.emps_sindy(record, tell),
            "sysidentpy": lambda: one_mass.emps_narmax(record, tell),
            "sysidentpy, told": lambda: one_mass.emps_narmax(record, tell, told=True),
        }
    else:
        record = one_mass.Silverbox(path, identified)
        own_error, before = 1e3 * error["after"], 1e3 * error["before"]
        runs = {
            "pysindy": lambda: one_mass.silverbox_sindy(record, tell),
            "sysidentpy": lambda: one_mass.silverbox_narmax(record, tell),
        }
    farreach = {
        "error": own_error,
        "error_before": before,
        "terms": parameters_of(identified),
        "model": [named(identified)],
        "seconds": own["seconds"],
        "processor_seconds": own["processor_seconds"],
        "load_average": own["load_average"],
    }
    files = {method: work / f"{re.sub('[^a-z]+', '-', method)}.json" for method in runs}
    peers = {
        method: kept(files[method], lambda run=run: timed(run)) for method, run in runs.items()
    }
    unit = "% of force" if name == "emps" else "mV"
    return {"case": name, "channel": channel, "unit": unit, "farreach": farreach, **peers}


# --- tables


def pair(error, digits=2):
    return (
        "lost" if error is None else f"{error['master']:.{digits}f} / {error['slave']:.{digits}f}"
    )


def tables(result):
    lines = [
        "| case | what is missing | method | 12.5 ms ahead | free, 10 s | innovation | terms |"
        " wall (s) | processor (s) |"
    ]
    lines.append("|---|---|---|---|---|---|---|---|---|")
    for case in result["cases"]:
        if "missing" not in case:
            continue
        first = f"{case['case']} | {', '.join(case['missing']) or 'nothing'}"
        lines.append(
            f"| {first} | constant speed | {pair(case['constant_speed']['ahead_mrad'])} | | |"
            " | | |"
        )
        for method in METHODS[:3]:
            of = case[method]
            innovation = "–" if method == "sysidentpy" else pair(of["innovation_mrad"])
            if method == "farreach":
                innovation += f" (declared {pair(of['innovation_before_mrad'])})"
            lines.append(
                f"| | | {method} | {pair(of['ahead_mrad'])} | {pair(of['free_mrad'], 0)} |"
                f" {innovation} | {of['terms']} | {of['seconds']:.0f} |"
                f" {of['processor_seconds']:.0f} |"
            )
    lines += [
        "",
        "| record | method | error on held-back rows | terms | wall (s) | processor (s) |",
        "|---|---|---|---|---|---|",
    ]
    for case in result["cases"]:
        if "missing" in case:
            continue
        for method in [m for m in METHODS if m in case]:
            of = case[method]
            digits = 2 if case["case"] == "emps" else 3
            before = (
                f" (declared {of['error_before']:.{digits}f})" if method == "farreach" else ""
            )
            lines.append(
                f"| {case['case']} | {method} | {of['error']:.{digits}f}{before} {case['unit']} |"
                f" {of['terms']} | {of['seconds']:.0f} | {of['processor_seconds']:.0f} |"
            )
    lines += ["", "What each reports:", ""]
    for case in result["cases"]:
        missing = (
            f" (missing: {', '.join(case['missing']) or 'nothing'})" if "missing" in case else ""
        )
        lines.append(f"- {case['case']}{missing}")
        for method in [m for m in METHODS if m in case]:
            text = "; ".join(
                f"`{line}`" if method != "farreach" else line for line in case[method]["model"]
            )
            settings = case[method].get("settings")
            told = f" [{', '.join(f'{k} {v}' for k, v in settings.items())}]" if settings else ""
            lines.append(f"  - {method}{told}: {text}")
    return "\n".join(lines)


def machine():
    model = next(
        (
            line.split(":", 1)[1].strip()
            for line in open("/proc/cpuinfo", encoding="utf-8")
            if line.startswith("model name")
        ),
        platform.processor(),
    )
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.release()}",
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("work", "farreach", "ahead", "cases", "data", "revision"):
        parser.add_argument(f"--{name}", required=True)
    parser.add_argument(
        "--case", action="append", help="a folder of --cases, emps or silverbox; repeatable"
    )
    args = parser.parse_args()
    for name in ("work", "farreach", "ahead", "cases", "data"):
        setattr(args, name, str(Path(getattr(args, name)).resolve()))
    # No random numbers are used here; if a library uses them, its results are repeatable.
    np.random.seed(1)
    cases = []
    for name in args.case or CASES:
        case = measured_case(args, name) if name in MEASURED else blind_case(args, name)
        if case is not None:
            cases.append(case)
    version = subprocess.run(
        [args.farreach, "--version"], capture_output=True, text=True, check=True
    ).stdout.strip()
    result = {
        "date": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d"),
        "machine": machine(),
        "revision": args.revision,
        "versions": (
            {"farreach": version, "python": platform.python_version()}
            | {package: importlib.metadata.version(package) for package in PACKAGES}
        ),
        "seed": 1,
        "threads": 1,
        "names_missing_effects": {"farreach": True, "pysindy": False, "sysidentpy": False},
        "cases": cases,
    }
    (Path(args.work) / "peers.json").write_text(json.dumps(result, indent=1), encoding="utf-8")
    versions = ", ".join(f"{name} {value}" for name, value in result["versions"].items())
    head = (
        f"{result['date']}, {result['machine']['processor']}, {result['machine']['cores']} cores,"
        f" one thread each; revision {result['revision']}; {versions}\n\nErrors in mrad rms,"
        " master / slave.\n\n"
    )
    text = head + tables(result)
    (Path(args.work) / "peers.md").write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
