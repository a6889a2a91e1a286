#!/usr/bin/env bash
# Boots systemd as process 1 in namespaces of its own, over this machine's files, which stay as they
# are: what is written goes to memory. Root only; nothing outside is touched but a control group.
# Runs until it is killed; all in it ends with it.
# usage: boot.sh FOLDER    FOLDER is made, and is seen inside under the same path
set -euo pipefail
work=$1
mkdir -p "$work"

# systemd wants a control group of its own, in the hierarchy of version 2.
groups=$(findmnt --noheadings --first-only --types cgroup2 --output TARGET || true)
if [ -z "$groups" ]; then
    groups="$work/cgroup"
    mkdir -p "$groups"
    mount -t cgroup2 none "$groups"
fi
group="$groups/farreach-test.$$"
mkdir "$group"
echo $$ >"$group/cgroup.procs"
echo "$group" >"$work/cgroup.path"

inside() {
    local work=$1 root=$1/root file
    # The upper layer of the files, in memory.
    mkdir -p "$work/layers" "$root"
    mount -t tmpfs -o size=1g layers "$work/layers"
    mkdir "$work/layers/upper" "$work/layers/work"
    mount -t overlay overlay \
        -o "lowerdir=/,upperdir=$work/layers/upper,workdir=$work/layers/work" "$root"
    mount -t proc proc "$root/proc"
    mount -t sysfs -o ro sysfs "$root/sys"
    mount -t cgroup2 cgroup "$root/sys/fs/cgroup"
    mount -t tmpfs -o mode=755 run "$root/run"
    mount -t tmpfs -o mode=1777 tmp "$root/tmp"
    mkdir -p "$root$work"
    mount --bind "$work" "$root$work"
    # Only the devices that everything needs.
    mount -t tmpfs -o mode=755 dev "$root/dev"
    for file in null zero full random urandom tty; do
        touch "$root/dev/$file"
        mount --bind "/dev/$file" "$root/dev/$file"
    done
    mkdir "$root/dev/pts" "$root/dev/shm"
    mount -t devpts -o newinstance,ptmxmode=0666 devpts "$root/dev/pts"
    ln -s pts/ptmx "$root/dev/ptmx"
    ln -s /proc/self/fd "$root/dev/fd"
    mount -t tmpfs -o mode=1777 shm "$root/dev/shm"
    # What this machine starts at boot is not wanted, and what it runs as itself neither.
    rm -rf "$root"/etc/systemd/system/*.wants
    tr -d - </proc/sys/kernel/random/uuid >"$root/etc/machine-id"
    for file in systemd-journald-audit.socket systemd-modules-load.service \
        systemd-random-seed.service systemd-remount-fs.service systemd-sysctl.service \
        systemd-udevd.service systemd-update-utmp.service systemd-udev-trigger.service; do
        ln -sf /dev/null "$root/etc/systemd/system/$file"
    done
    hostname farreach-test
    ip link set lo up
    cd "$root"
    mkdir -p old
    pivot_root . old
    umount -l /old
    exec env -i container=other PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \
        /lib/systemd/systemd --system --unit=basic.target --show-status=no \
        --log-target=journal-or-kmsg
}
export -f inside
exec unshare --pid --mount --ipc --uts --cgroup --net --fork --kill-child=SIGKILL \
    --propagation private bash -euo pipefail -c 'inside "$1"' bash "$work"
