"""A machine in namespaces of its own that systemd runs as process 1 (boot.sh)."""

import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent


class Machine:
    """Boots in `with`, and ends with it, together with all that runs in it."""

    def __enter__(self):
        self.work = Path(tempfile.mkdtemp(prefix="farreach-systemd."))
        self.work.chmod(0o755)
        self.log = open(self.work / "boot.log", "wb")
        self.boot = subprocess.Popen(
            [HERE / "boot.sh", self.work],
            stdin=subprocess.DEVNULL,
            stdout=self.log,
            stderr=self.log,
        )
        try:
            self._wait_until_up()
        except BaseException:
            self.__exit__()
            raise
        return self

    def _wait_until_up(self):
        until = time.monotonic() + 60
        while time.monotonic() < until:
            if self.boot.poll() is not None:
                break
            children = Path(f"/proc/{self.boot.pid}/task/{self.boot.pid}/children").read_text()
            if children.split():
                self.init = int(children.split()[0])
                if Path(f"/proc/{self.init}/comm").read_text().strip() == "systemd":
                    found = self.run("systemctl", "is-system-running", check=False).stdout.strip()
                    if found in ("running", "degraded"):
                        return
            time.sleep(0.2)
        raise RuntimeError(
            "systemd did not come up:\n" + (self.work / "boot.log").read_text(errors="replace")
        )

    def __exit__(self, *_):
        # The kernel ends all of its namespace with process 1.
        self.boot.send_signal(signal.SIGKILL)
        self.boot.wait()
        self.log.close()
        group = self.work / "cgroup.path"
        if group.exists():
            remove_group(Path(group.read_text().strip()))
        subprocess.run(["umount", self.work / "cgroup"], stderr=subprocess.DEVNULL, check=False)
        shutil.rmtree(self.work, ignore_errors=True)

    def popen(self, *command, user="root", **options):
        """Starts a command inside, as a user who has logged in."""
        enter = ["nsenter", f"--target={self.init}", "--all", "--wdns=/", "--"]
        if user != "root":
            enter += ["setpriv", f"--reuid={user}", f"--regid={user}", "--init-groups", "--"]
        environment = {
            "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
            "LC_ALL": "C.UTF-8",
            "FARREACH_RIG_NAME": "bench",
        }
        return subprocess.Popen(
            enter + list(map(str, command)),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
            **options,
        )

    def run(self, *command, user="root", check=True, timeout=120):
        """Runs a command inside; its result."""
        process = self.popen(*command, user=user)
        try:
            out, err = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        done = subprocess.CompletedProcess(command, process.returncode, out, err)
        if check and done.returncode != 0:
            raise RuntimeError(f"{command} ({user}): exit code {done.returncode}\n{out}{err}")
        return done

    def put(self, path, text):
        """Writes a file inside."""
        at = Path(f"/proc/{self.init}/root{path}")
        at.parent.mkdir(parents=True, exist_ok=True)
        at.write_text(text)

    def shown(self, unit, *names):
        """Properties of a unit."""
        command = ["systemctl", "show", f"--property={','.join(names)}", "--", unit]
        lines = self.run(*command).stdout.splitlines()
        return dict(line.split("=", 1) for line in lines if "=" in line)

    def json(self, *command, user="root"):
        """What a command prints as JSON."""
        return json.loads(self.run(*command, user=user).stdout)


def remove_group(path):
    """Removes a control group with all below it, once its last process is gone."""
    for _ in range(50):
        for below in sorted(path.rglob("*"), reverse=True):
            if below.is_dir():
                try:
                    os.rmdir(below)
                except OSError:
                    pass
        try:
            os.rmdir(path)
            return
        except FileNotFoundError:
            return
        except OSError:
            time.sleep(0.1)
