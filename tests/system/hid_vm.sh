#!/usr/bin/env bash
# Devices as the kernel shows them, in a small virtual machine: SpaceMice made with uhid, read through hidraw and hidapi; a USB
# device with Force Dimension's vendor id, made by the kernel's own gadget; the udev rules under a real udevd.
#   hid_vm.sh BUILD_DIR        exit status 77: no virtual machine can be had here (vm.sh says why)
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
[ $# -ge 1 ] || { sed -n '2,4p' "$0"; exit 2; }
build=$(realpath "$1")

if [ "${2:-}" != inside ]; then
  exec bash "$here/vm.sh" --seconds 550 --modules "uhid hid-generic dummy_hcd libcomposite usb_f_acm" "$here/hid_vm.sh" "$build" inside
fi

failed=0
check() { # words, then a command that must succeed
  local words=$1; shift
  if "$@" >/tmp/last 2>&1; then echo "ok   $words"; else echo "FAIL $words: $(tail -n 3 /tmp/last | tr '\n' ' ')"; failed=1; fi
}
master=$build/bin/telenano-master
as_nobody() { setpriv --reuid=65534 --regid=65534 --clear-groups "$@"; }
says() { # text, then a command: it must say so, on either stream
  local text=$1; shift
  local said; said=$("$@" 2>&1) || true
  case $said in *"$text"*) ;; *) echo "says: $said"; return 1 ;; esac
}

# SpaceMice. Those under Logitech's id have a driver of their own, which takes real USB only: the general one does as well.
echo 1 >/sys/module/hid/parameters/ignore_special_drivers
check "pucks through uhid, hidraw and hidapi" "$build/bin/system_hidraw"
grep -q 'SKIPPED' /tmp/last && { echo "FAIL the tests of hidraw were skipped"; failed=1; }

# A device with the vendor's id on a bus that the kernel plays itself.
mount -t configfs none /sys/kernel/config 2>/dev/null || true
gadget=/sys/kernel/config/usb_gadget/omega
mkdir -p $gadget/strings/0x409 $gadget/configs/c.1 $gadget/functions/acm.0
echo 0x1451 >$gadget/idVendor; echo 0x0402 >$gadget/idProduct
echo "omega.3" >$gadget/strings/0x409/product; echo "Force Dimension" >$gadget/strings/0x409/manufacturer
ln -s $gadget/functions/acm.0 $gadget/configs/c.1/
ls /sys/class/udc | head -1 >$gadget/UDC
for ((i = 0; i < 50; ++i)); do grep -qs 1451 /sys/bus/usb/devices/*/idVendor && break; sleep 0.1; done
found=$(grep -ls 1451 /sys/bus/usb/devices/*/idVendor || true)
node=$(printf '/dev/bus/usb/%03d/%03d' "$(cat "${found%idVendor}busnum")" "$(cat "${found%idVendor}devnum")")
check "the kernel shows a USB node" test -c "$node"
unset FDSDK
check "without SDK its node is listed, with the reason" says "omega,omega.3,,$node,no,\"Force Dimension SDK not found" "$master" devices
# The stand-in's script is all zeros: an SDK that counts no device, as it does when it may not open any.
mkdir -p /tmp/open/lib/release/lin-x86_64-gcc && cp "$build"/standin_sdk/lib/release/lin-x86_64-gcc/* /tmp/open/lib/release/lin-x86_64-gcc/
cp "$master" /tmp/open/
export FDSDK=/tmp/open TELENANO_STANDIN_DRD=/tmp/open/script
truncate -s 65536 "$TELENANO_STANDIN_DRD"; chmod 0666 "$TELENANO_STANDIN_DRD"; chmod 0600 "$node"
check "no right to its node is said, with the way out" says "no permission to open $node: copy deploy/udev/70-telenano-haptic.rules" as_nobody /tmp/open/telenano-master run --device omega
chmod 0666 "$node"
check "the right to it changes what is said" says "switch the device off and on" as_nobody /tmp/open/telenano-master run --device omega
exec 9<>"$node"
check "who has it open is said" says "has $node open; end it first" "$master" run --device omega
exec 9>&-

# The rules. (udevadm settle does not wait in a machine that was not started by systemd: look until it is so.)
tagged() { # node
  local i
  for ((i = 0; i < 150; ++i)); do
    udevadm info --query=property --name="$1" | grep -E '^CURRENT_TAGS=.*:uaccess:' && return 0
    sleep 0.1
  done
  udevadm info --query=property --name="$1"
  return 1
}
if [ -x /lib/systemd/systemd-udevd ]; then
  mkdir -p /etc/udev/rules.d && cp "$here/../../deploy/udev/70-telenano-haptic.rules" /etc/udev/rules.d/
  /lib/systemd/systemd-udevd --daemon 2>/dev/null
  echo add >"${found%idVendor}uevent"  # udevadm trigger does nothing there either
  check "the omega's node is tagged for whoever sits here" tagged "$node"
  check "udevd finds no mistake in the rules" bash -c "! udevadm test \$(udevadm info --query=path --name=$node) 2>&1 | grep -E '70-telenano-haptic.rules:[0-9]+ .*(nvalid|nknown|rror)'"
  TELENANO_HOLD_PUCK_S=20 "$build/bin/system_hidraw" --gtest_filter='*StaysForAWhile' >/dev/null &
  for ((i = 0; i < 150; ++i)); do [ ! -e /dev/hidraw0 ] || break; sleep 0.1; done
  check "a puck's node is tagged likewise" tagged /dev/hidraw0
else
  echo "note: udev is not installed here: its rules are not tried"
fi
exit $failed
