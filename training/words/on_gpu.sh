#!/usr/bin/env bash
# Trains the words model on a machine with a GPU and 16 cores, which needs neither MuJoCo nor a network.
#
#   training/words/on_gpu.sh begin MOTIONS SECONDS [options of the trainer]   starts workers and trainer, and returns
#   training/words/on_gpu.sh wait SECONDS OUT                                 waits at most so long, copies what there is
#
# MOTIONS is a folder of `training.words.motions`; MOTIONS/held has those on which the model is measured. The weights
# come in parts of at most 15 MiB: cat OUT/weights.?? > weights.pt
set -euo pipefail
cd "$(dirname "$0")/../.."
work=/tmp/words-training
export OMP_NUM_THREADS=1 PYTHONUNBUFFERED=1 PYTHONPATH=$PWD${PYTHONPATH:+:$PYTHONPATH}
workers=${WORKERS:-14}
case $1 in
begin)
    motions=$2 seconds=$3
    shift 3
    rm -rf "$work"
    mkdir -p "$work/examples"
    setsid nohup python3 -m training.words.trainer "$work/examples" "$work/out" --seconds "$seconds" "$@" \
        > "$work/trainer.log" 2>&1 &
    # compiles the kernels once
    python3 -m training.words.examples "$motions/held" "$work/examples/held" --files "${HELD:-4}" --worker 99
    for i in $(seq 0 $((workers - 1))); do
        setsid nohup python3 -m training.words.examples "$motions" "$work/examples" --worker "$i" --seconds "$seconds" \
            > "$work/worker.$i.log" 2>&1 &
    done
    ;;
wait)
    end=$((SECONDS + $2))
    while [ $SECONDS -lt $end ] && pgrep -f training.words.trainer > /dev/null; do sleep 1; done
    tail -n 3 "$work/trainer.log" | cut -c 1-1500
    tail -q -n 1 "$work"/worker.*.log | tail -n 4
    cp "$work"/trainer.log "$work"/out/log.jsonl "$3/" || true
    if [ -f "$work/out/weights.pt" ]; then split -b 15728640 -d -a 2 "$work/out/weights.pt" "$3/weights."; fi
    ls -la "$3"
    ;;
esac
