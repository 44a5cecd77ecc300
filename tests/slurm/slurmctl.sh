#!/bin/sh
# A Slurm of one node for tests: slurmctl.sh start|stop FOLDER. Needs Debian's slurm-wlm, and root.
# Prints the SLURM_CONF to export. It writes in FOLDER alone and stops only its own daemons.
set -eu
action=$1
mkdir -p "$2"
dir=$(cd "$2" && pwd)

stop() {
    for name in slurmd slurmctld munged; do
        [ -s "$dir/$name.pid" ] && kill "$(cat "$dir/$name.pid")" 2>/dev/null || true
    done
}

if [ "$action" = stop ]; then stop; exit 0; fi

for program in munged slurmctld slurmd sbatch; do
    command -v "$program" >/dev/null && continue
    echo "no $program here; run: sudo apt-get install slurm-wlm" >&2
    exit 2
done
[ "$(id -u)" = 0 ] || { echo "slurmd needs root to start jobs; run as root" >&2; exit 2; }

umask 077
dd if=/dev/urandom of="$dir/munge.key" bs=1024 count=1 2>/dev/null
chmod 711 "$dir"
mkdir -p "$dir/spool" "$dir/state"
munged --key-file="$dir/munge.key" --socket="$dir/munge.socket" --pid-file="$dir/munged.pid" \
    --log-file="$dir/munged.log" --seed-file="$dir/munged.seed" --force

cores=$(nproc)
memory=$(awk '/MemTotal/ { print int($2 / 1024) }' /proc/meminfo)
host=$(hostname -s)
cat >"$dir/slurm.conf" <<CONF
ClusterName=one
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
SlurmctldPort=26817
SlurmdPort=26818
AuthType=auth/munge
AuthInfo=socket=$dir/munge.socket
CryptoType=crypto/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
JobRequeue=1
KillWait=5
OverTimeLimit=0
ReturnToService=2
MpiDefault=none
SchedulerParameters=sched_interval=5,batch_sched_delay=0
StateSaveLocation=$dir/state
SlurmdSpoolDir=$dir/spool
SlurmctldPidFile=$dir/slurmctld.pid
SlurmdPidFile=$dir/slurmd.pid
SlurmctldLogFile=$dir/slurmctld.log
SlurmdLogFile=$dir/slurmd.log
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
JobCompType=jobcomp/filetxt
JobCompLoc=$dir/jobs.txt
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cores RealMemory=$memory State=UNKNOWN
PartitionName=test Nodes=$host Default=YES MaxTime=INFINITE State=UP
CONF
chmod 644 "$dir/slurm.conf"
export SLURM_CONF="$dir/slurm.conf"
slurmctld -c
slurmd
for _ in $(seq 30); do
    [ "$(sinfo --noheader --format=%t 2>/dev/null)" = idle ] && { echo "$SLURM_CONF"; exit 0; }
    sleep 1
done
echo "the node did not come up; see $dir/slurmctld.log and slurmd.log" >&2
stop
exit 1
