#!/bin/bash
# Boot systemd as PID 1 in namespaces of its own, on an overlay of this machine's / (nothing is written back), with
# the program at /opt/quavelet/venv/bin/quavelet; run the script JOB as a oneshot unit, print its output, and end.
#   private_systemd.sh JOB UNIT PYTHON_PREFIX SITE_PACKAGES REPOSITORY
set -e
if [ -z "$INSIDE" ]; then
    export INSIDE=1
    exec unshare --mount --pid --fork --cgroup --ipc --uts --net --kill-child "$0" "$@"
fi
JOB=$1 UNIT=$2 PREFIX=$3 SITE=$4 REPOSITORY=$5
mount --make-rprivate /
W=$(mktemp -d)
mount -t tmpfs tmpfs "$W"
mkdir "$W"/{upper,work,root}
R=$W/root
mount -t overlay -o "lowerdir=/,upperdir=$W/upper,workdir=$W/work" overlay "$R"
mount -t proc proc "$R/proc"
mount -t sysfs -o ro sysfs "$R/sys"
mount -t cgroup2 cgroup2 "$R/sys/fs/cgroup"
mount -t tmpfs -o mode=755 tmpfs "$R/run"
mount -t tmpfs -o mode=755 tmpfs "$R/dev"
for n in null zero full random urandom tty; do touch "$R/dev/$n"; mount --bind "/dev/$n" "$R/dev/$n"; done
mkdir "$R"/dev/{shm,pts}
mount -t devpts devpts "$R/dev/pts" -o newinstance,ptmxmode=0666
ln -s pts/ptmx "$R/dev/ptmx"

# The interpreter, its packages and the source may lie where the unit must not look (/home, /tmp): bind them.
Q=$R/opt/quavelet
mkdir -p "$Q"/{python,site,repository,venv/bin}
mount --bind "$PREFIX" "$Q/python"
mount --bind "$SITE" "$Q/site"
mount --bind "$REPOSITORY" "$Q/repository"
cat > "$Q/venv/bin/python" <<P
#!/bin/sh
export LD_LIBRARY_PATH=/opt/quavelet/python/lib PYTHONDONTWRITEBYTECODE=1
export PYTHONPATH=/opt/quavelet/repository/src:/opt/quavelet/repository:/opt/quavelet/site
exec /opt/quavelet/python/bin/python3 "\$@"
P
cat > "$Q/venv/bin/quavelet" <<P
#!/bin/sh
exec /opt/quavelet/venv/bin/python -c 'import sys; sys.argv[0] = "/opt/quavelet/venv/bin/quavelet"; from quavelet.cli.app import main; main()' "\$@"
P
chmod 755 "$Q"/venv/bin/*

mkdir -p "$R/run/job" "$R/run/systemd/system"
mkfifo "$R/run/job/output"
cp "$JOB" "$R/run/job/script"
cp "$UNIT" "$R/run/systemd/system/"
# It would empty /tmp, where the machine's own files are seen.
ln -s /dev/null "$R/run/systemd/system/systemd-tmpfiles-setup.service"
cat > "$R/run/systemd/system/job.target" <<T
[Unit]
Requires=job.service
Wants=systemd-journald.service
After=job.service
AllowIsolate=yes
T
cat > "$R/run/systemd/system/job.service" <<T
[Unit]
DefaultDependencies=no
After=systemd-journald.service
SuccessAction=exit-force
FailureAction=exit-force
[Service]
Type=oneshot
ExecStart=/bin/bash -c 'exec >/run/job/output 2>&1; bash -eu /run/job/script; echo job ended with \$?'
T
cat "$R/run/job/output" &
cd /
exec chroot "$R" env -i container=private PATH=/usr/sbin:/usr/bin:/sbin:/bin TERM=dumb \
    /lib/systemd/systemd --system --unit=job.target --log-target=null --show-status=no </dev/null
