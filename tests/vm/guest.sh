#!/bin/sh
# What happens in the VM. Boot 1: scanners are plugged in, a map is saved, and the power goes. Boot 2: all of it is there.
# The host reads what is said here; PASSED and the last line of boot 1 are what it waits for.
set -eu
state=/var/lib/submapd
word() { sed -n "s/.*$1=\([^ ]*\).*/\1/p" /proc/cmdline; }
say() { echo "$(cut -d' ' -f1 /proc/uptime) $*"; }
fail() {
  say "FAILED: $*"
  systemctl --no-pager status submapd.service || true
  journalctl --no-pager -n 60 || true
  exit 1
}
trap '[ $? -eq 0 ] || say "FAILED in the line after the last message"' EXIT

wait_for() {  # SECONDS WHAT COMMAND...
  seconds=$1 what=$2
  shift 2
  until "$@"; do
    seconds=$((seconds - 1))
    [ "$seconds" -gt 0 ] || fail "waited too long for $what"
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
scanners_are_there() { [ "$(grep -l 15d1 /sys/bus/usb/devices/*/idVendor 2>/dev/null | wc -l)" = 2 ]; }
both_stream() { at_least horizontal scans 80 && at_least vertical scans 80; }

the_service_runs_by_itself() {
  wait_for 60 "the service runs by itself" systemctl is-active --quiet submapd.service
  [ "$(systemctl show --value -p NRestarts submapd.service)" = 0 ] || fail "it was restarted"
  systemctl is-active --quiet submapd-lcm-route.service || fail "no multicast route"
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

the_scanners_are_plugged_in() {
  for card in /sys/class/net/e*; do
    ip link set "${card##*/}" up
    ip address add 10.0.2.15/24 dev "${card##*/}"
  done
  modprobe vhci-hcd
  for port in 1-1 1-2; do
    usbip --tcp-port "$(word submapd.port)" attach -r 10.0.2.2 -b "$port"
  done
  wait_for 60 "two scanners on the bus" scanners_are_there
  udevadm settle --timeout=30
  for vendor in $(grep -l 15d1 /sys/bus/usb/devices/*/idVendor); do
    device=${vendor%/idVendor}
    node=/dev/$(sed -n 's/^DEVNAME=//p' "$device/uevent")
    [ "$(stat -c '%G %a' "$node")" = "hokuyo 660" ] || fail "$node is $(stat -c '%G %a' "$node"): the udev rule"
    [ "$(cat "$device/power/control")" = on ] || fail "$device may be suspended: the udev rule"
    udevadm info "$device" | grep -q ID_MM_DEVICE_IGNORE=1 || fail "ModemManager would take $device"
  done
  wait_for 120 "both scanners stream" both_stream
}

rates() {
  main=$(systemctl show --value -p MainPID submapd.service)
  ticks() { cut -d' ' -f14,15 "/proc/$main/stat" | tr ' ' + ; }
  h=$(number horizontal scans) v=$(number vertical scans) cpu=$(($(ticks))) at=$(cut -d' ' -f1 /proc/uptime)
  sleep 10
  echo "$h $(number horizontal scans) $v $(number vertical scans) $cpu $(($(ticks))) $at $(cut -d' ' -f1 /proc/uptime)" |
    awk '{ s = $8 - $7; printf "in %.0f s: %.1f and %.1f scans/s; processor of the emulated machine %.0f %%\n", s, ($2 - $1) / s,
           ($4 - $3) / s, ($6 - $5) / s }'
}

maps_verify() {
  if submapctl --help | grep -q '^  verify '; then
    for run in "$state"/runs/*; do
      submapctl verify "$run" || fail "submapctl verify $run"
    done
    say "submapctl verify finds all runs whole"
    return
  fi
  for manifest in "$state"/runs/*/maps/*/MANIFEST; do
    # Name and hash of each file, in two lines of the JSON text.
    (cd "$(dirname "$manifest")" &&
      sed -n 's/^ *"name": "\(.*\..*\)".*/\1/p; s/^ *"sha256": "\(.*\)".*/\1/p' MANIFEST | paste - - |
      awk 'length($1) == 64 { print $1 "  " $2; next } { print $2 "  " $1 }' | sha256sum --check --strict --quiet) ||
      fail "$manifest does not fit its files"
  done
  say "there is no submapctl verify: hashes of saved maps are right"
}

the_service_runs_by_itself
case $(word submapd.boot) in
  1)
    the_scanners_are_plugged_in
    say "$(rates)"
    submapctl save-map before --wait
    wait_for 200 "two finished sub-maps" at_least recorder last_submap 1
    say "$(submapctl status)"
    ls "$state"/runs/*/submaps > "$state/submaps-before"
    sync "$state/submaps-before"
    say "POWER: cut it"
    sleep 600
    ;;
  2)
    journalctl --no-pager -k | grep -i 'ext4.*recover' || fail "the disk was not in use when the power went"
    for name in $(cat "$state/submaps-before"); do
      [ -s "$(echo "$state"/runs/*/submaps/"$name")" ] || fail "sub-map $name is lost"
    done
    say "$(wc -l < "$state/submaps-before") sub-maps survived"
    maps_verify
    the_scanners_are_plugged_in
    submapctl save-map after --wait
    maps_verify
    say "$(submapctl status)"
    say "$(rates)"
    systemctl stop submapd.service
    [ "$(systemctl show --value -p Result submapd.service)" = success ] || fail "it did not stop in good order"
    ;;
esac
say PASSED
