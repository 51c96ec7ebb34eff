# waymarkd on a simulated camera, in a network of its own. Sourced by scripts/bench.

# memory_of PID: resident memory, and the page faults of the SLAM thread up to now.
memory_of() {
  local task
  printf 'resident %s MiB' "$(awk '/^VmRSS/ { printf "%.1f", $2 / 1024 }' "/proc/$1/status")"
  for task in "/proc/$1/task"/*; do
    [[ $(< "$task/comm") == wm-slam ]] || continue
    awk '{ printf ", page faults of the SLAM thread %d", $10 + $12 }' "$task/stat"
  done
  printf '\n'
}
export -f memory_of

# live_run RATE_HZ SECONDS PRIORITY: what a subscriber sees; PRIORITY 0 is the ordinary scheduler.
live_run() {
  local rate=$1 seconds=$2 priority=$3 url='udpm://239.255.76.67:7667?ttl=0'
  cat > "$work/live.toml" << END
[camera]
source = "sim:walls"
rate_hz = $rate
[slam]
dictionary = "ARUCO_MIP_36h12"
marker_size_m = 0.165
[publish]
url = "$url"
[realtime]
capture_priority = $((priority > 0 ? priority + 1 : 0))
slam_priority = $priority
publisher_priority = $((priority > 0 ? priority - 1 : 0))
lock_memory = $( ((priority > 0)) && echo true || echo false)
END
  # shellcheck disable=SC2016 # the inner shell's variables
  unshare --net bash -c '
    ip link set lo up
    ip link set lo multicast on
    ip route add 224.0.0.0/4 dev lo
    build/release/daemon/waymarkd --config "$1" 2> "$1.log" &
    daemon=$!
    (sleep 60; [[ $3 -le 60 ]] || echo "after 60 s: $(memory_of "$daemon")") &
    build/release/tools/waymark echo --url "$2" --quiet --stats --duration "$3"
    [[ $3 -le 60 ]] || echo "after $3 s: $(memory_of "$daemon")"
    kill "$daemon"
    wait "$daemon"' live "$work/live.toml" "$url" "$seconds"
  grep -i 'without real-time\|not locked' "$work/live.toml.log" || true
}

live_table() {
  local rate priority
  printf 'Load of the computer: %s\n' "$(cut -d' ' -f1-3 /proc/loadavg)"
  for rate in 150 1000; do
    for priority in 50 0; do
      printf '%s Hz, %s\n' "$rate" \
        "$( ((priority > 0)) && echo "SCHED_FIFO $priority, memory locked" || echo "ordinary scheduler")"
      live_run "$rate" "$((rate == 150 ? 600 : 60))" "$priority" | sed 's/^/    /'
    done
  done
}
