#!/usr/bin/env python3
"""Runs the tests of the comedi card on the kernel's own drivers, in a virtual machine.

Debian's cloud kernel and its modules comedi, comedi_test and comedi_parport are taken out of its
package, which is not installed; the machine is QEMU's software emulation, so no rights are needed
to run it. Its time passes with the instructions that it has carried out, and jumps where it has
none: 60 s of streaming are the same 60 s however busy the computer is, and idle ones cost nothing.
The initial file system holds busybox, the test programs with the libraries that they
name, and an init that loads the modules and runs the tests. The result is what they print: the
verdict of each program, and `guest exit 0`.

usage: comedi_qemu.py [--keep FOLDER]    exit code 0 passed, 1 failed, 77 cannot be run here
"""

import argparse
import json
import lzma
import os
import re
import shutil
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

# What a run may take (s) on a busy computer.
LIMIT = 900
MODULES = ["comedi", "comedi_test", "comedi_parport"]
# Folder, test.
TESTS = [("services/watchdog", "enable_output"), ("services/acquisition", "comedi")]
PACKAGES = ["qemu-system-x86", "busybox-static"]
INIT = """#!/bin/busybox sh
/bin/busybox mkdir -p /proc /sys /dev /tmp
/bin/busybox mount -t devtmpfs dev /dev
/bin/busybox mount -t proc proc /proc
/bin/busybox mount -t sysfs sysfs /sys
/bin/busybox insmod /comedi.ko comedi_num_legacy_minors=2
/bin/busybox insmod /comedi_test.ko amplitude=10000000 period=100000
/bin/busybox insmod /comedi_parport.ko
export FARREACH_COMEDI=1 RUST_BACKTRACE=1 TMPDIR=/tmp
code=0
for program in {programs}; do
    echo "guest: $program"
    /$program --test-threads=1 --nocapture || code=1
done
/bin/busybox dmesg | /bin/busybox grep -i comedi | /bin/busybox tail -n 5
echo "guest exit $code"
/bin/busybox reboot -f
"""


class Missing(Exception):
    """The machine lacks something that nobody here may install."""


def output_of(*command, **options):
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True,
                          **options).stdout


def install(packages):
    """Installs packages where root may, else says what is missing."""
    if os.getuid() != 0 or not shutil.which("apt-get"):
        raise Missing(f"the packages {' '.join(packages)}, which root may install")
    subprocess.run(["apt-get", "update", "-qq"], check=True)
    subprocess.run(
        ["apt-get", "install", "-y", "-qq", "--no-install-recommends", *packages], check=True,
        stdout=subprocess.DEVNULL, env=os.environ | {"DEBIAN_FRONTEND": "noninteractive"})


def busybox():
    """A busybox that needs no library."""
    found = shutil.which("busybox")
    if found and b"not a dynamic" in subprocess.run(
            ["ldd", found], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            check=False).stdout:
        return found
    return None


def kernel(work):
    """The kernel and its comedi modules, out of Debian's package: paths by name."""
    for tool in ("apt-get", "dpkg-deb"):
        if not shutil.which(tool):
            raise Missing(f"{tool}: the kernel comes out of a package of Debian's")
    depends = subprocess.run(["apt-cache", "depends", "linux-image-cloud-amd64"],
                             stdout=subprocess.PIPE, text=True, check=False).stdout
    package = re.search(r"Depends: (linux-image-\S+)", depends)
    if not package:
        raise Missing("a package linux-image-cloud-amd64, which Debian has for x86_64")
    # Root's own folder may be closed to the user that apt downloads as.
    subprocess.run(["apt-get", "download", "-qq", package[1]], check=True, cwd=work,
                   stderr=subprocess.DEVNULL)
    deb = next(work.glob("linux-image-*.deb"))
    subprocess.run(["dpkg-deb", "-x", deb, work / "kernel"], check=True)
    files = {"vmlinuz": next((work / "kernel/boot").glob("vmlinuz-*"))}
    for name in MODULES:
        found = [path for path in (work / "kernel").rglob(f"{name}.ko*") if path.is_file()]
        module = found[0].read_bytes()
        if found[0].suffix == ".xz":
            module = lzma.decompress(module)
        path = work / f"{name}.ko"
        path.write_bytes(module)
        files[path.name] = path
    return package[1], files


def test_programs(work):
    """The test programs, without symbols, and all files that they load: paths by guest's path."""
    # With the features of the whole workspace, so that nothing is compiled twice.
    names = [word for _, test in TESTS for word in ("--test", test)]
    lines = output_of("cargo", "test", "--workspace", *names, "--locked", "--no-run",
                      "--message-format=json", stderr=subprocess.DEVNULL)
    messages = [json.loads(line) for line in lines.splitlines()]
    files, programs = {}, []
    for folder, test in TESTS:
        built = next(message["executable"] for message in messages if message.get("executable")
                     and message["target"]["src_path"].endswith(f"{folder}/tests/{test}.rs"))
        program = f"{Path(folder).name}-{test}"
        subprocess.run(["strip", "-o", work / program, built], check=True)
        programs.append(program)
        files[program] = work / program
        # "libc.so.6 => /lib/libc.so.6 (0x...)", and the loader by its path alone
        for library in re.findall(r"(/\S+) \(0x", output_of("ldd", built)):
            files[library.lstrip("/")] = Path(library).resolve()
    return programs, files


def archive(entries):
    """A cpio archive in the `newc` format, which the kernel unpacks into its first file system.
    `entries`: name, mode, contents."""
    parts = []
    for number, (name, mode, contents) in enumerate([*entries, ("TRAILER!!!", 0, b"")], 1):
        encoded = name.encode() + b"\0"
        # inode, mode, uid, gid, links, time, size, device (2), node (2), length of name, checksum
        fields = [number, mode, 0, 0, 1, 0, len(contents), 0, 0, 0, 0, len(encoded), 0]
        head = b"070701" + b"".join(b"%08x" % field for field in fields) + encoded
        parts += [head, b"\0" * (-len(head) % 4), contents, b"\0" * (-len(contents) % 4)]
    return b"".join(parts)


def initial_file_system(files, programs):
    init = INIT.format(programs=" ".join(programs)).encode()
    folders = {str(parent) for name in files for parent in Path(name).parents} - {"."}
    folders |= {"bin", "dev", "proc", "sys", "tmp"}
    entries = [(folder, stat.S_IFDIR | 0o755, b"") for folder in sorted(folders)]
    entries += [(name, stat.S_IFREG | 0o755, path.read_bytes())
                for name, path in sorted(files.items())]
    return archive([*entries, ("init", stat.S_IFREG | 0o755, init)])


def run(work, vmlinuz, initrd):
    """Boots, hands the console on, and returns it; None where the time was not enough."""
    command = [
        "qemu-system-x86_64", "-M", "q35", "-m", "512", "-smp", "1",
        "-accel", "tcg", "-icount", "shift=3,sleep=off",
        "-nodefaults", "-display", "none", "-no-reboot", "-serial", "stdio",
        "-chardev", "null,id=port", "-device", "isa-parallel,iobase=0x378,chardev=port",
        "-kernel", vmlinuz, "-initrd", initrd,
        "-append", "console=ttyS0 quiet panic=-1 reboot=t"]
    console = work / "console.txt"
    with console.open("wb") as to:
        machine = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=to,
                                   stderr=subprocess.STDOUT)
        try:
            machine.wait(LIMIT)
        except subprocess.TimeoutExpired:
            machine.kill()
            machine.wait()
    text = console.read_bytes().decode(errors="replace").replace("\r", "")
    return re.sub(r"\x1b\[[0-9;?=]*[a-zA-Z]|\x1bc", "", text)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--keep", type=Path, help="keeps kernel, programs and console here")
    keep = parser.parse_args().keep
    with tempfile.TemporaryDirectory(prefix="comedi-qemu.") as temporary:
        work = keep or Path(temporary)
        work.mkdir(exist_ok=True)
        work.chmod(0o755)
        try:
            if not shutil.which("qemu-system-x86_64") or not busybox():
                install(PACKAGES)
            package, files = kernel(work)
        except Missing as missing:
            print(f"SKIPPED: comedi's kernel drivers: needs {missing}")
            return 77
        programs, libraries = test_programs(work)
        vmlinuz = files.pop("vmlinuz")
        files |= libraries | {"bin/busybox": Path(busybox())}
        initrd = work / "initramfs.cpio"
        initrd.write_bytes(initial_file_system(files, programs))
        print(f"{package}; {len(programs)} programs, {initrd.stat().st_size >> 20} MiB", flush=True)
        console = run(work, vmlinuz, initrd)
    print(console)
    passed = len(re.findall(r"^test result: ok", console, re.M))
    if passed == len(programs) and re.search(r"^guest exit 0$", console, re.M):
        return 0
    print(f"FAILED: {passed} of {len(programs)} programs passed, or the machine did not end in "
          f"{LIMIT} s", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
