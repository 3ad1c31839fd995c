#!/usr/bin/env bash
# A whole Slurm of one node on loopback, in a folder of its own, for as long as a command runs:
#   one_node_slurm.sh FOLDER COMMAND...
# Exit 77 (skip) without root or Slurm's and Munge's programs.
set -euo pipefail
folder=$(realpath -m "$1")
shift
skip() { echo "one_node_slurm.sh: skipped: $*"; exit 77; }
[ "$(id -u)" -eq 0 ] || skip "needs root"
export PATH=$PATH:/usr/sbin
for program in munged mungekey slurmctld slurmd sinfo; do
  command -v "$program" >/dev/null || skip "no $program (Debian: slurm-wlm, munge)"
done

rm -rf "$folder"
mkdir -p "$folder"/{munge,ctld,spool}
chmod 711 "$folder"
chmod 700 "$folder/munge"
mungekey --create --keyfile "$folder/munge/key"
socket=$folder/munge.socket
host=$(hostname -s)
# Ports of this test's own, so that it disturbs no Slurm of the machine.
port=$((20000 + $$ % 20000))
cat >"$folder/slurm.conf" <<CONF
ClusterName=loopback
SlurmctldHost=$host(127.0.0.1)
AuthType=auth/munge
AuthInfo=socket=$socket
CryptoType=crypto/munge
SlurmUser=root
SlurmctldPort=$port
SlurmdPort=$((port + 1))
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
StateSaveLocation=$folder/ctld
SlurmdSpoolDir=$folder/spool
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
SchedulerParameters=sched_interval=1
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=$(($(awk '/MemTotal/ {print $2}' /proc/meminfo) / 1024)) State=UNKNOWN
PartitionName=loopback Nodes=$host Default=YES MaxTime=INFINITE State=UP
CONF
export SLURM_CONF=$folder/slurm.conf

pids=()
cleanup() {
  for pid in "${pids[@]}"; do kill "$pid" 2>/dev/null || true; done
  wait 2>/dev/null || true
}
trap cleanup EXIT
munged --foreground --key-file="$folder/munge/key" --socket="$socket" --pid-file="$folder/munge/pid" \
  --log-file="$folder/munge/log" --seed-file="$folder/munge/seed" --num-threads=2 --force &
pids+=($!)
for _ in $(seq 50); do [ -S "$socket" ] && break; sleep 0.1; done
[ -S "$socket" ] || { echo "one_node_slurm.sh: munged did not start" >&2; exit 1; }
slurmctld -D -f "$SLURM_CONF" >"$folder/slurmctld.out" 2>&1 &
pids+=($!)
slurmd -D -f "$SLURM_CONF" -N "$host" >"$folder/slurmd.out" 2>&1 &
pids+=($!)
for _ in $(seq 100); do
  sinfo -h -o %T 2>/dev/null | grep -q idle && break
  sleep 0.2
done
sinfo -h -o %T | grep -q idle || {
  echo "one_node_slurm.sh: the node does not come up" >&2
  tail -n 20 "$folder"/slurmctld.log "$folder"/slurmd.log >&2
  exit 1
}
"$@"
