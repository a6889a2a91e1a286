"""Installs the Debian package on a machine that systemd runs as process 1 (machine.py) and tries a
rig on it: rights, commands, restarts, the order of a stop.

usage: check.py PACKAGE
"""

import json
import re
import shutil
import sys
import time
from pathlib import Path

from machine import Machine

# Of every rig, and what this one has enabled.
PROCESSES = ["keeper", "logger", "simulator", "acquisition", "control", "experiment", "watchdog",
             "console"]
LOOPS = {"simulator", "acquisition", "control", "experiment", "watchdog"}
CAPABILITIES = (1 << 23) | (1 << 14)  # CAP_SYS_NICE, CAP_IPC_LOCK
FIFO = 1
DATA = "/var/lib/farreach/bench"
PROTOCOL = """
[protocol]
name = "short"
description = "A short guided movement"

[[segments]]
kind = "guided_sine"
label = "guided"
amplitude_deg = 20.0
frequency_hz = 0.5
duration_s = {duration}
centre_deg = 0.0
fade_in_s = 2.0
fade_out_s = 1.0
"""


def expect(condition, text):
    if not condition:
        raise AssertionError(text)
    print(f"  {text}", flush=True)


def unit(process):
    return f"farreach-{process}@bench.service"


def wait_for(what, condition, seconds=30):
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        found = condition()
        if found:
            return found
        time.sleep(0.1)
    raise AssertionError(f"not within {seconds} s: {what}")


class Bench:
    """The rig `bench` on the machine."""

    def __init__(self, machine, package):
        self.machine = machine
        self.package = package

    def farreach(self, *arguments, user="alice", **options):
        return self.machine.run("farreach", *arguments, user=user, **options)

    def units(self):
        """Main process and number of restarts of each unit that runs."""
        names = ["ActiveState", "MainPID", "NRestarts"]
        shown = {name: self.machine.shown(unit(name), *names) for name in PROCESSES}
        return {
            name: (int(of["MainPID"]), int(of["NRestarts"]))
            for name, of in shown.items()
            if of["ActiveState"] == "active" and of["MainPID"] != "0"
        }

    def install(self):
        package = self.machine.work / "farreach.deb"
        shutil.copy(self.package, package)
        self.machine.run("dpkg", "--install", package)
        for name, groups in (("alice", ["--groups", "farreach"]), ("mallory", [])):
            self.machine.run("useradd", "--create-home", "--user-group", *groups, name)
        self.machine.put("/etc/farreach/bench/environment",
                         "FARREACH_CARD=simulated\nFARREACH_CONSOLE=127.0.0.1:0\n")
        self.machine.run("cp", "/usr/share/doc/farreach/examples/rig.toml", "/etc/farreach/bench/")
        for name, duration in (("short", 6.0), ("long", 60.0)):
            self.machine.put(f"/srv/{name}.toml", PROTOCOL.format(duration=duration))
        for process in ("simulator", "console"):
            self.machine.run("systemctl", "enable", unit(process))
        for page in ("man1/farreach.1.gz", "man1/farreach-rec-cat.1.gz"):
            self.machine.run("test", "-s", f"/usr/share/man/{page}")
        expect(True, "the package installs")

    def files(self):
        machine = self.machine
        verified = machine.run("sh", "-c", "systemd-analyze verify --man=no "
                               "/usr/lib/systemd/system/farreach*", check=False)
        said = [line for line in (verified.stdout + verified.stderr).splitlines()
                if "farreach" in line]
        expect(not said, f"systemd-analyze verify finds nothing {said or ''}")
        machine.run("visudo", "--check", "--file=/etc/sudoers.d/farreach")
        for name in [*PROCESSES, "monitor"]:
            told = machine.run("systemd-analyze", "security", "--no-pager", unit(name),
                               check=False).stdout
            found = re.search(r"exposure level for \S+: ([\d.]+) (\w+)", told)
            expect(found and float(found[1]) < 5.0,
                   f"exposure of {name}: {found and found[0].split(': ')[1]}")

    def comes_up(self):
        self.farreach("up")
        status = self.machine.json("farreach", "status", "--json", user="alice")
        expect(status["state"] == "up" and status["supervision"] == "systemd",
               "a member of the group brings the rig up")
        states = {process["name"]: process["state"] for process in status["processes"]}
        expect(states == dict.fromkeys(PROCESSES, "ready"), "all processes are ready")
        expect(status["watchdog"] is not None and status["gate"] is not None,
               f"status reads the topics (profile {status['profile']})")
        self.fifo = status["profile"] == "realtime" or (status["host_stall"] or {}).get("fifo")
        told = self.farreach("status").stdout
        expect("under systemd" in told.splitlines()[0], "status: " + told.splitlines()[0])
        refused = self.farreach("status", user="mallory", check=False)
        expect(refused.returncode == 1 and "Join the group farreach" in refused.stderr,
               "who is not of the group is refused")
        refused = self.farreach("down", user="mallory", check=False)
        expect(refused.returncode == 1 and "as root: systemctl stop" in refused.stderr,
               "who is not of the group stops nothing")
        self.farreach("status", user="root")
        expect(True, "root asks as the rig's user")

    def rights(self):
        script = """
import json, os, sys
found = {}
for pid in sys.argv[1:]:
    lines = dict(line.split(':', 1) for line in open(f'/proc/{pid}/status').read().splitlines())
    found[pid] = [lines[key].split()[0] for key in ('Uid', 'Gid', 'NoNewPrivs')]
    found[pid] += [int(lines[key], 16) for key in ('CapEff', 'CapBnd')]
    found[pid].append([os.sched_getscheduler(int(task)) & 0xff
                       for task in os.listdir(f'/proc/{pid}/task')])
    found[pid].append(int(lines['VmLck'].split()[0]))
print(json.dumps(found))
"""
        units = self.units()
        pids = {name: str(pid) for name, (pid, _) in units.items()}
        found = self.machine.json("python3", "-c", script, *pids.values())
        user, group = (self.machine.run("id", option, "farreach").stdout.strip()
                       for option in ("-u", "-g"))
        for name, pid in pids.items():
            uid, gid, closed, effective, bound, classes, locked_kib = found[pid]
            wanted = CAPABILITIES if name in LOOPS | {"keeper"} else 0
            expect((uid, gid, closed) == (user, group, "1") and uid != "0"
                   and effective == bound == wanted,
                   f"{name}: user {uid}, capabilities {effective:#x} of {bound:#x}")
            if self.fifo and name in LOOPS:
                expect(FIFO in classes and locked_kib > 0,
                       f"{name} runs in SCHED_FIFO with {locked_kib} KiB locked")

    def plays(self):
        self.farreach("rec", "start", f"{DATA}/run.mcap")
        for protocol in ("home", "/srv/short.toml"):
            outcome = self.powered(protocol)
            expect(outcome["outcome"] == "completed", f"run {protocol}: {outcome['elapsed_s']} s")
        self.farreach("disarm")
        stopped = self.farreach("rec", "stop")
        told = self.farreach("rec", "verify", f"{DATA}/run.mcap", check=False)
        expect(told.returncode == 0, f"the recording is whole: {stopped.stdout.strip()}")
        refused = self.farreach("rec", "start", "/tmp/run.mcap", check=False)
        expect(refused.returncode == 1, f"refused: {refused.stderr.strip()}")

    def powered(self, protocol):
        """Plays a protocol; a rig that trips on a busy host is armed again, twice at most."""
        for again in range(3):
            self.farreach("reset", check=False)
            self.farreach("arm", check=False)
            done = self.farreach("run", "--json", protocol, check=False)
            if done.returncode == 0:
                return json.loads(done.stdout)
            print(f"note: {protocol}, {again + 1} of 3: {done.stderr.strip()} {done.stdout}")
        raise AssertionError(f"{protocol} was not played")

    def console(self):
        told = self.machine.json("farreach", "console", "--json", user="alice")
        page, token = told["operator"].split("#token=")
        fetch = "import sys, urllib.request as u; print(u.urlopen(sys.argv[1]).read().decode())"
        text = self.machine.run("python3", "-c", fetch, page).stdout
        expect("<html" in text and len(token) == 32, f"the console answers at {page}")

    def restarts(self, name, signal, patience):
        """Sends a signal to the process of a unit: systemd starts that one again, and no other."""
        before = self.units()
        expect(set(before) == set(PROCESSES), f"{signal} to {name}, of {len(before)} processes")
        begun = time.monotonic()
        self.machine.run("kill", f"-{signal}", before[name][0])

        def again():
            now = self.units()
            return now if set(now) == set(before) and now[name][1] > before[name][1] else None

        after = wait_for(f"{name} is ready again", again, patience)
        others = {other for other in before if before[other] != after[other]} - {name}
        expect(not others and after[name][0] != before[name][0],
               f"{name} is ready again after {time.monotonic() - begun:.1f} s; no other restarted "
               f"{others or ''}")

    def stops_motor_first(self):
        self.farreach("rec", "start", f"{DATA}/stop.mcap")
        self.powered("home")
        played = self.machine.popen("farreach", "run", "/srv/long.toml", user="alice")
        wait_for("the motor has power", lambda: self.machine.json(
            "farreach", "status", "--json", user="alice")["gate"]["motor_power"])
        time.sleep(2)
        begun = time.time()
        self.machine.run("systemctl", "stop", "farreach@bench.target")
        played.communicate(timeout=60)
        # The target is over before its units are.
        order, well = wait_for("all units have stopped", lambda: self.journal_since(begun))
        expect(order[0] in ("watchdog", "console") and order[-2:] == ["logger", "keeper"]
               and order.index("watchdog") < min(map(order.index, LOOPS - {"watchdog"})),
               f"stopped in the order {', '.join(order)}")
        expect(well == set(PROCESSES), "all ended by themselves")
        self.recorded_stop()
        left = self.machine.run("sh", "-c", "ls -d /dev/shm/farreach* /run/farreach/* 2>/dev/null",
                                check=False).stdout
        expect(not left, f"nothing is left in /dev/shm and /run {left}")

    def journal_since(self, begun):
        """The processes in the order in which their units stopped, and those that ended well."""
        told = self.machine.run("journalctl", "--output=json", "--output-fields=UNIT,MESSAGE",
                                f"--since=@{begun:.3f}", "_PID=1").stdout
        if self.units() or "Stopped farreach-keeper@" not in told:
            return None
        order, well = [], set()
        for line in map(json.loads, told.splitlines()):
            found = re.fullmatch(r"farreach-(\w+)@bench.service", line.get("UNIT", ""))
            if found and line["MESSAGE"].startswith("Stopped "):
                order.append(found[1])
            elif found and line["MESSAGE"].endswith("Deactivated successfully."):
                well.add(found[1])
        return order, well

    def recorded_stop(self):
        """In the recording: the motor has volts, loses them, and only then the others end."""
        command = ["rec", "cat", "--json", f"{DATA}/stop.mcap", "--topic"]
        samples = [json.loads(line)["fields"]
                   for line in self.farreach(*command, "sample").stdout.splitlines()]
        powered = [sample["time_ns"] for sample in samples if sample["motor_power"]]
        driven = [sample["time_ns"] for sample in samples if any(sample["motor_v"])]
        # All may have ended before the relay opens: the card's timeout is 40 ms.
        expect(driven and powered and not any(samples[-1]["motor_v"]),
               f"the motor had 0 V at the end: of {len(samples)} samples {len(powered)} with "
               f"power, {len(driven)} with volts")
        ends = {}
        for process in ("watchdog", "control", "acquisition", "experiment", "simulator"):
            told = self.farreach(*command, f"event/{process}").stdout
            events = map(json.loads, told.splitlines())
            ends[process] = max(event["fields"]["time_ns"] for event in events
                                if event["names"]["kind"] == "process ending")
        first = min(ends[process] for process in ends if process != "watchdog")
        expect(driven[-1] < first and ends["watchdog"] < first,
               f"the motor had 0 V {(first - driven[-1]) / 1e6:.0f} ms before the next process "
               "ended")
        # The card's timeout of the enable line, without real-time scheduling, and some cycles.
        relay = (powered[-1] - ends["watchdog"]) / 1e6
        expect(relay < 45, f"its relay opened {relay:.0f} ms after the watchdog had ended")
        told = self.farreach("rec", "verify", f"{DATA}/stop.mcap", check=False)
        expect(told.returncode == 0, "the recording of the stop is whole")

    def goes_down(self):
        self.farreach("up")
        told = self.farreach("down").stdout
        expect("stopped watchdog" in told and "is down" in told, "a member of the group stops it")
        down = self.farreach("status", check=False)
        expect(down.returncode == 1 and "is not up" in down.stdout,
               f"status: {down.stdout.strip()}")
        self.farreach("up", user="root")
        self.machine.run("dpkg", "--remove", "farreach")
        expect(not self.units(), "the removal of the package stops the rig")


def main():
    package = Path(sys.argv[1]).resolve()
    begun = time.monotonic()
    with Machine() as machine:
        print(f"systemd is up after {time.monotonic() - begun:.1f} s", flush=True)
        bench = Bench(machine, package)
        try:
            bench.install()
            bench.files()
            bench.comes_up()
            bench.rights()
            bench.plays()
            bench.console()
            for name in PROCESSES:
                bench.restarts(name, "KILL", 30)
            for name in PROCESSES:
                bench.restarts(name, "STOP", 40)
            bench.stops_motor_first()
            bench.goes_down()
        except BaseException:
            journal = machine.run("journalctl", "--no-pager", "--lines=200", check=False).stdout
            print(journal, file=sys.stderr)
            raise
    print(f"all good, in {time.monotonic() - begun:.0f} s")


if __name__ == "__main__":
    main()
