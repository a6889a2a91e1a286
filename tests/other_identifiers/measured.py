"""Writes the table of docs/identify-measured.md: `farreach identify`, a hand fit, PySINDy and
SysIdentPy on every set of records that others measured.

Called by run_measured.sh. The table stands between two markers of the page; all else of the page is
left as it is. Sets whose records are absent are said and get no line.
"""

import argparse
import datetime
import importlib.metadata
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
from scipy.optimize import lsq_linear

import balance
import data
import one_mass
import sindy

ROOT = Path(__file__).resolve().parents[2]
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
# What is right for each set, and the effects of the hand fit beside the declared terms. The rows
# of tools/identify/tests/measured.rs say the same.
SETS = {
    "tue-slave-free": ("Coulomb friction", ["coulomb"]),
    "tue-slave-spring": ("unlisted, over position", ["spring", "coulomb"]),
    "tue-slave-oscillator": ("Coulomb friction", ["coulomb"]),
    "tue-spring-alone": ("nothing, or a mass", ["mass"]),
    "tue-master-spring": ("Coulomb friction", ["coulomb"]),
    "tue-slave-foam": ("unlisted, over position", ["spring", "coulomb"]),
    "bam-xl330": ("gravity", ["gravity"]),
    "pendulum-free": ("nothing", []),
    "odrive-cogging": ("torque ripple", ["ripple 7"]),
    "kuka-joint6": ("Coulomb friction", ["coulomb"]),
    "damper-36lb": ("presliding hysteresis or backlash", ["dahl", "mass"]),
    "double-pendulum-a": ("gravity", ["gravity", "coulomb"]),
    "emps": ("Coulomb and asymmetric friction", ["coulomb", "asymmetric"]),
    "silverbox": ("nonlinear stiffness", ["cubic"]),
}
BENCHMARKS = {
    "emps": ("emps_train.csv", "launch/rigs/emps.toml"),
    "silverbox": ("silverbox_multisine.csv", "launch/rigs/silverbox.toml"),
}
# Beginnings of the names of the three declared terms of each kind, in the order of the columns.
TERMS = {
    "drive": ("mass", "viscous", ("force_offset", "torque_offset", "offset")),
    "element": ("stiffness", "viscous", ("force_offset", "torque_offset", "offset")),
    "oscillator": ("mass", "damping", "stiffness", "input_offset"),
}


def tell(text):
    print(text, file=sys.stderr, flush=True)


def files(args, name):
    """The rig file of a set, and its records; no records if they are absent."""
    if name in BENCHMARKS:
        record, rig = BENCHMARKS[name]
        paths = [args.data / record]
        return ROOT / rig, [path for path in paths if path.exists()]
    folder = args.data / "measured" / name
    return folder / "rig.toml", sorted(folder.glob("*.csv"))


def identify(args, name, rig, paths):
    """farreach's JSON output, and None; or, where it refuses, None and the reason."""
    file = args.work / f"{name}.json"
    file.unlink(missing_ok=True)
    command = [args.farreach, "identify", "--rig", rig, *paths, "--seed", "1", "--json", file]
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    found = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    if done.returncode != 0 or "records" not in found:
        reason = done.stderr.strip() or str(found)
        tell(f"{name}: refused: {reason}")
        return None, reason
    return found, None


def said(identified, reason):
    """The answer in a few words."""
    if identified is None:
        return "refused: " + reason.split("`: ")[-1].split(";")[0]
    effects = [effect["id"].replace("_", " ") for effect in identified["effects"]]
    text = " + ".join(effects)
    if not effects:
        text = {"none": "nothing is missing"}.get(identified["verdict"], identified["verdict"])
    elif identified["verdict"] not in ("effect", "ambiguous"):
        text = f"{identified['verdict']}, beside {text}"
    rivals = [rival["id"].replace("_", " ") for rival in identified["ambiguous_with"]]
    if rivals:
        text += f" (or {', '.join(rivals)})"
    if identified.get("unlisted"):
        text += f"; something over {identified['unlisted']['depends_on'].replace('_', ' ')}"
    return text


def bounds(rig, kind):
    """Ranges of the declared terms, from the tolerances; friction and mass are not negative."""
    declared = rig["model"]["parameters"]
    found = []
    for begins in TERMS[kind]:
        name = next((n for n in declared if n.startswith(begins)), None)
        if name is None:
            found.append((-1e-12, 1e-12))
            continue
        of = declared[name]
        half = max(of.get("tolerance", 0.0) * abs(of["value"]), of.get("tolerance_absolute", 0.0))
        low = of["value"] - half
        found.append((low if "offset" in name else max(low, 0.0), of["value"] + half))
    return found


# --- oscillators: the simulated output


class Oscillator(one_mass.Silverbox):
    """Several records of an oscillator one after another, at 500 Hz; each is a block."""

    finer, cut_offs_hz = 1, (20.0, 40.0, 80.0)
    rate_hz, settling = 500.0, 50

    def __init__(self, paths, identified):
        inputs, outputs, self.parts, self.blocks = [], [], [], {}
        for path in paths:
            table = data.columns(path)
            time_s = table["t_s"]
            step_s = float((time_s[-1] - time_s[0]) / (len(time_s) - 1))
            every = max(round(1.0 / (step_s * self.rate_hz)), 1)
            self.step_s = step_s * every
            inputs.append(data.low_pass(table["input"], 0.4 * self.rate_hz, step_s)[::every])
            outputs.append(data.low_pass(table["output"], 0.4 * self.rate_hz, step_s)[::every])
        ends = np.cumsum([len(part) for part in inputs])
        self.parts = [(end - len(part), end) for part, end in zip(inputs, ends, strict=True)]
        self.input, self.output = np.concatenate(inputs), np.concatenate(outputs)
        by_name = {path.name: part for path, part in zip(paths, self.parts, strict=True)}
        for role, names in identified["records"].items():
            parts = [by_name[Path(name).name] for name in names]
            self.blocks[role] = [
                (first + one_mass.BEFORE, end - self.settling) for first, end in parts
            ]

    def wave(self, signal, order, cut_off_hz=None, finer=1):
        return np.concatenate(
            [
                data.Spectrum(signal[a:b], self.step_s, continued=1024).wave(order, cut_off_hz)
                for a, b in self.parts
            ]
        )


def hand_oscillator(box, ranges, effects):
    """Least squares of the input over the declared terms and the effect; then simulated."""
    tried = []
    widths = balance.WIDTHS if effects == ["coulomb"] else (None,)
    for cut_off in box.cut_offs_hz:
        y, v, a = (box.wave(box.output, order, cut_off) for order in (0, 1, 2))
        u = box.wave(box.input, 0, cut_off)
        rows = np.concatenate([np.arange(*block) for block in box.blocks["fit"]])
        for width in widths:
            terms = ["v", "y", "1", "y * y", "y * y * y"]
            made = [a, v, y, np.ones_like(y), y**2, y**3]
            if width is not None:
                smooth = width * float(data.rms(v))
                terms[3:], made[4:] = [f"tanh(v / {smooth!r})"], [np.tanh(v / smooth)]
            table = np.column_stack(made)[rows]
            scale = data.rms(table)
            low, high = np.full(len(made), -np.inf), np.full(len(made), np.inf)
            low[:4], high[:4] = np.array(ranges).T * scale[:4]
            found = lsq_linear(table / scale, u[rows], (low, high)).x / scale
            coefficients = np.array([[*(-found[1:] / found[0]), 1.0 / found[0]]])
            equations = sindy.Equations(["y", "v"], ["input"], [*terms, "input"], coefficients)
            with np.errstate(all="ignore"):
                error = box.millivolts(box.simulate(equations, "select", y, v), "select")
            tried.append((error, len(tried), equations, (y, v)))
    _, _, equations, motion = min(tried, key=lambda t: t[:2])
    with np.errstate(all="ignore"):
        return box.millivolts(box.simulate(equations, "report", *motion), "report")


def oscillator(name, paths, identified, ranges, effects):
    """Errors of hand fit, PySINDy and SysIdentPy, percent of the output."""
    box = (
        one_mass.Silverbox(paths[0], identified)
        if name == "silverbox"
        else Oscillator(paths, identified)
    )
    rows = np.concatenate([np.arange(*block) for block in box.blocks["report"]])
    percent = 0.1 / float(data.rms(box.output[rows]))
    by_hand = hand_oscillator(box, ranges, effects)
    sparse, lagged = one_mass.silverbox_sindy(box, tell), one_mass.silverbox_narmax(box, tell)
    return (
        percent * by_hand,
        (percent * sparse["error"], sparse["terms"]),
        (percent * lagged["error"], lagged["terms"]),
    )


# --- the table


def line(args, name):
    """A line of the table; None if the records are absent."""
    rig_file, paths = files(args, name)
    if not paths:
        tell(f"=== {name}: SKIPPED, {args.data} has no records of it; it is no part of the project")
        return None
    tell(f"=== {name}")
    rig = tomllib.loads(rig_file.read_text(encoding="utf-8"))
    kind = rig["model"]["kind"]
    expected, effects = SETS[name]
    identified, reason = identify(args, name, rig_file, paths)
    ranges = bounds(rig, kind)
    if kind == "oscillator":
        if identified is None:
            return f"| `{name}` | {expected} | {said(identified, reason)} | – | – | – | – |"
        errors = oscillator(name, paths, identified, ranges, effects)
    else:
        turn_m = rig["model"]["parameters"].get("motor_turn_m")
        rotary = "torque_nm" in data.columns(paths[0])
        per_turn = 2.0 * np.pi / turn_m["value"] if turn_m else 1.0 if rotary else None
        records = balance.Balance(paths, kind, identified, per_turn)
        by_hand = balance.hand(records, kind, ranges, effects)
        errors = by_hand, balance.pysindy(records), balance.sysidentpy(records)
    digits = 2 if name in BENCHMARKS else 1
    own = "–"
    if identified is not None:
        error = next(iter(identified["error"].values()))
        own = f"{error['before_percent']:.{digits}f} → {error['after_percent']:.{digits}f}"
    by_hand, *peers = errors
    cells = [f"`{name}`", expected, said(identified, reason), own, f"{by_hand:.{digits}f}"]
    cells += [f"{error:.{digits}f} ({terms})" for error, terms in peers]
    return "| " + " | ".join(cells) + " |"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("work", "farreach", "data", "page", "revision"):
        parser.add_argument(f"--{name}", required=True)
    parser.add_argument("--set", action="append", choices=SETS, help="these alone; not to the page")
    args = parser.parse_args()
    for name in ("work", "farreach", "data", "page"):
        setattr(args, name, Path(getattr(args, name)).resolve())
    text = args.page.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    np.random.seed(1)
    lines = [line(args, name) for name in args.set or SETS]
    versions = " ".join(
        f"{title} {importlib.metadata.version(title.lower())},"
        for title in ("PySINDy", "SysIdentPy")
    )
    date = datetime.datetime.now(datetime.timezone.utc).date().isoformat()
    table = [
        f"{date}, revision {args.revision}, {versions[:-1]}.",
        "",
        "| set | expected | identify says | identify: before → after | hand fit | PySINDy |"
        " SysIdentPy |",
        "|---|---|---|---|---|---|---|",
        *[made for made in lines if made is not None],
    ]
    print("\n".join(table))
    if args.set or None in lines:
        tell(f"{args.page} is left as it is: not all sets were run")
        return
    page = f"{before}{BEGIN}\n\n" + "\n".join(table) + f"\n\n{END}{after}"
    args.page.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
