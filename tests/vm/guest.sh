#!/bin/sh
# What happens in the VM. Boot 1: scanners are plugged in, a map is saved, and the power goes. Boot 2: all of it is there.
# The host reads what is said here: PASSED and the last line of boot 1 are what it waits for, KEPT lines it compares.
set -eu
state=/var/lib/submapd
word() { sed -n "s/.*$1=\([^ ]*\).*/\1/p" /proc/cmdline; }
uptime_s() { cut -d. -f1 /proc/uptime; }
say() { echo "$(cut -d' ' -f1 /proc/uptime) $*"; }
fail() {
  say "FAILED: $*"
  systemctl --no-pager status submapd.service || true
  journalctl --no-pager -n 60 || true
  trap - EXIT
  exit 1
}
trap '[ $? -eq 0 ] || say "FAILED in the line after the last message"' EXIT

wait_for() {  # SECONDS WHAT COMMAND...
  until=$(($(uptime_s) + $1)) what=$2
  shift 2
  until "$@"; do
    [ "$(uptime_s)" -lt "$until" ] || fail "waited too long for: $what"
    sleep 1
  done
  say "$what"
}
# A number of submapctl health --json; its keys stand one a line.
number() { submapctl health --json 2>/dev/null | sed -n "/\"$1\": {/,\$p" | sed -n "s/^ *\"$2\": \([0-9.]*\).*/\1/p" | head -n 1; }
at_least() {  # SECTION KEY NUMBER
  found=$(number "$1" "$2")
  [ "${found%%.*}" -ge "$3" ] 2>/dev/null
}
scanners_on_the_bus() { grep -l 15d1 /sys/bus/usb/devices/*/idVendor 2>/dev/null | wc -l; }
there_are() { [ "$(scanners_on_the_bus)" = "$1" ]; }
both_stream() { at_least horizontal scans "$1" && at_least vertical scans "$1"; }
raw_bytes_on_disk() { cat "$state"/runs/*/raw-*.lcmlog | wc -c; }

the_service_runs_by_itself() {
  wait_for 60 "the service runs by itself" systemctl is-active --quiet submapd.service
  [ "$(systemctl show --value -p NRestarts submapd.service)" = 0 ] || fail "it was restarted"
  systemctl is-active --quiet submapd-lcm-route.service || fail "no multicast route"
  stamp() { systemctl show --value -p "$1" submapd.service; }
  say "ready after $((($(stamp ActiveEnterTimestampMonotonic) - $(stamp InactiveExitTimestampMonotonic)) / 1000)) ms"
  main=$(systemctl show --value -p MainPID submapd.service)
  # As the user submapd, without capabilities: LimitRTPRIO and LimitMEMLOCK are enough.
  grep -q '^CapEff:.*0000000000000000' "/proc/$main/status" || fail "it has capabilities"
  locked=$(sed -n 's/^VmLck:[[:space:]]*\([0-9]*\) kB/\1/p' "/proc/$main/status")
  [ "$locked" -gt 10000 ] || fail "only $locked kB are locked"
  for thread in usb:60 mapper:40; do
    for task in "/proc/$main/task/"*; do
      [ "$(cat "$task/comm")" = "${thread%:*}" ] || continue
      chrt -p "${task##*/}" | grep -q "priority: ${thread#*:}" || fail "$(chrt -p "${task##*/}")"
    done
  done
  say "locked memory $locked kB, threads at SCHED_FIFO"
}

plug_in() { usbip attach -r 127.0.0.1 -b "$1" 2>/dev/null; }

the_scanners_are_plugged_in() {
  there_are 0 || fail "there are scanners before they are plugged in"
  systemctl show --value -p StatusText submapd.service | grep -q "not plugged in" || fail "it does not say what is missing"
  hokuyo-sim --front usbip --scanners 2 --boot 0 --log /opt/drive.lcmlog > /dev/null &
  modprobe vhci-hcd
  wait_for 60 "one cable is in" plug_in 1-1
  wait_for 60 "and the other" plug_in 1-2
  wait_for 60 "two scanners on the bus" there_are 2
  udevadm settle --timeout=30
  for vendor in $(grep -l 15d1 /sys/bus/usb/devices/*/idVendor); do
    device=${vendor%/idVendor}
    node=/dev/$(sed -n 's/^DEVNAME=//p' "$device/uevent")
    [ "$(stat -c '%G %a' "$node")" = "hokuyo 660" ] || fail "$node is $(stat -c '%G %a' "$node"): the udev rule"
    [ "$(cat "$device/power/control")" = on ] || fail "$device may be suspended: the udev rule"
    udevadm info "$device" | grep -q ID_MM_DEVICE_IGNORE=1 || fail "ModemManager would take $device"
  done
  say "udev rule: group, mode, autosuspend, ModemManager"
  wait_for 120 "both scanners stream" both_stream 80
  for interface in /sys/bus/usb/devices/*:1.*; do
    grep -q 15d1 "${interface%:*}/idVendor" 2>/dev/null || continue
    [ "$(basename "$(readlink "$interface/driver")")" = usbfs ] || fail "$interface is not the daemon's"
  done
}

one_cable_is_pulled() {
  usbip detach -p 0
  wait_for 60 "one cable is pulled" there_are 1
  wait_for 60 "and in again" plug_in 1-1
  wait_for 60 "that scanner is taken again" at_least horizontal reconnects 1
  before=$(number horizontal scans)
  wait_for 60 "and streams" at_least horizontal scans $((before + 80))
}

# QEMU runs each instruction in 1 ns: processor time is a number of instructions.
cost() {
  main=$(systemctl show --value -p MainPID submapd.service)
  for task in "/proc/$main/task/"*; do
    [ "$(cat "$task/comm")" != usb ] || usb=$task
  done
  measure() { echo "$(number horizontal scans) $(number vertical scans) $(cut -d' ' -f1 "$usb/schedstat")"; }
  first=$(measure)
  sleep 4
  echo "$first $(measure)" |
    awk '{ n = $4 - $1 + $5 - $2; printf "the usb thread took %.0f thousand instructions a scan (%d scans)\n", ($6 - $3) / n / 1e3, n }'
}

all_is_whole() {
  for run in "$state"/runs/*; do
    submapctl verify "$run" || fail "submapctl verify $run"
  done
}

# Finished sub-maps and saved maps by their hashes. Nothing is written: it must not be our sync that saves them.
what_is_kept() {
  for file in "$state"/runs/*/submaps/*.submap "$state"/runs/*/maps/*/MANIFEST; do
    say "KEPT $(sha256sum "$file")"
  done
}

the_service_runs_by_itself
case $(word submapd.boot) in
  1)
    the_scanners_are_plugged_in
    submapctl save-map before --wait
    say "a map is saved"
    one_cable_is_pulled
    say "$(cost)"
    wait_for 200 "two finished sub-maps" at_least recorder last_submap 1
    say "$(submapctl status)"
    what_is_kept
    say "RAW $(number recorder raw_bytes)"
    sleep 2  # a second's scans may be lost, and this processor is slow
    submapctl save-map cut --cloud
    say "POWER: cut it"
    sleep 600
    ;;
  2)
    journalctl --no-pager -k | grep -i 'ext4.*recover' || fail "the disk was not in use when the power went"
    say "RAW $(raw_bytes_on_disk)"
    what_is_kept
    [ "$(ls "$state/runs" | wc -l)" = 1 ] || fail "the run does not go on: $(ls "$state/runs")"
    [ -z "$(find "$state"/runs/*/maps "$state"/runs/*/submaps -name '.*')" ] || fail "something half written is left"
    journalctl --no-pager -b -u submapd.service | grep 'was cut off and goes on' || fail "it does not say that it goes on"
    all_is_whole
    say "all that was kept is whole"
    the_scanners_are_plugged_in
    submapctl save-map after --wait
    say "a map is saved"
    say "$(submapctl status)"
    systemctl stop submapd.service
    [ "$(systemctl show --value -p Result submapd.service)" = success ] || fail "it did not stop in good order"
    all_is_whole
    ;;
esac
say PASSED
