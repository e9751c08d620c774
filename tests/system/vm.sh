#!/usr/bin/env bash
# Runs a script as root inside a small virtual machine with Debian's own kernel, for what this machine's kernel may not have
# (tc netem, /dev/uhid). See usage below.
set -euo pipefail
usage() {
  cat <<'H'
usage: tests/system/vm.sh [OPTIONS] SCRIPT [ARGUMENT ...]
       tests/system/vm.sh --prepare        installs QEMU and fetches the kernel (needs apt, the network, about 150 MB)

Boots in about ten seconds (QEMU, emulated: code runs 5 to 6 times slower, so for what works, not for how fast). The script sees this machine's files under their own paths, read-only; what it writes goes to
memory and is gone, except for what it writes to /out.

  --modules "A B"   kernel modules to load first, besides those the machine itself needs
  --out DIR         a directory that the script sees as /out and may write (default: one that is removed)
  --seconds S       longest time it may take (default 300)
  --cpus N          virtual processors (default 2)
  --memory-mb M     default 1536
  --kvm             use the processor's own virtualisation (not the default: inside other virtual machines it may hang)

Exit status: the script's own; 77 where a virtual machine cannot be had here (one line on standard error says why); 98 out of
time; 99 the machine did not come to its end.
The kernel is kept in $TELENANO_VM_CACHE (default ~/.cache/telenano/vm).
H
}

cache=${TELENANO_VM_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/telenano/vm}
cannot() { printf 'vm: cannot run here: %s\n' "$*" >&2; exit 77; }
wrong() { printf 'vm: %s; see --help\n' "$*" >&2; exit 2; }

install_tools() {
  local need=(qemu-system-x86 busybox-static kmod cpio iproute2) missing=() package
  for package in "${need[@]}"; do
    dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
  done
  [ ${#missing[@]} -gt 0 ] || return 0
  local as_root=()
  [ "$(id -u)" = 0 ] || as_root=(sudo)
  "${as_root[@]}" apt-get update -qq
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
}

# The kernel's image and the kinds of modules that a test can ask for; graphics, sound and network cards stay out.
fetch_kernel() {
  local work kernel
  work=$(mktemp -d "$cache/fetch.XXXXXX")
  kernel=$(apt-cache depends linux-image-amd64 | awk '/Depends:/ {print $2; exit}')
  [ -n "$kernel" ] || cannot "apt knows no linux-image-amd64: run apt-get update"
  (cd "$work" && apt-get download -qq -o APT::Sandbox::User=root "$kernel" >/dev/null) || { rm -rf "$work"; cannot "$kernel could not be downloaded"; }
  mkdir "$work/root"
  dpkg-deb --fsys-tarfile "$work"/linux-image-*.deb | tar -x -C "$work/root" \
    --exclude='*/kernel/sound' --exclude='*/kernel/drivers/gpu' --exclude='*/kernel/drivers/media' \
    --exclude='*/kernel/drivers/net/wireless' --exclude='*/kernel/drivers/net/ethernet' --exclude='*/kernel/drivers/infiniband' \
    --exclude='*/kernel/drivers/scsi' --exclude='*/kernel/drivers/staging' --exclude='./usr' --exclude='./boot/System.map*'
  depmod -b "$work/root" "$(ls "$work/root/lib/modules")" 2>/dev/null
  mv "$work"/root/boot/vmlinuz-* "$work/root/vmlinuz"
  rm -rf "${cache:?}/kernel" "$cache/initrd.gz"
  mv "$work/root" "$cache/kernel"
  rm -rf "$work"
}

# What the kernel starts from: busybox and the modules that reach this machine's files. The rest is loaded from there.
make_initrd() {
  local work version file
  version=$(ls "$cache/kernel/lib/modules")
  work=$(mktemp -d "$cache/initrd.XXXXXX")
  mkdir -p "$work"/{bin,proc,sys,dev,mod,host,layer,new}
  cp "$(command -v busybox)" "$work/bin/"
  for file in virtio_pci 9p 9pnet_virtio overlay; do
    modprobe -d "$cache/kernel" -S "$version" --show-depends "$file" | awk '/^insmod/ {print $2}'
  done | awk '!seen[$0]++' | while read -r file; do
    cp "$file" "$work/mod/"
    basename "$file" >>"$work/mod/order"
  done
  cat >"$work/init" <<'INIT'
#!/bin/busybox sh
/bin/busybox --install -s /bin
mount -t proc proc /proc; mount -t sysfs sys /sys; mount -t devtmpfs dev /dev
while read -r module; do insmod "/mod/$module" || echo "vm: insmod $module failed"; done </mod/order
ip link set lo up
mount -t 9p -o trans=virtio,version=9p2000.L,ro,msize=262144,cache=loose host /host
mount -t tmpfs layer /layer && mkdir /layer/upper /layer/work
mount -t overlay -o lowerdir=/host,upperdir=/layer/upper,workdir=/layer/work overlay /new
for place in proc sys dev; do mount --bind /$place /new/$place; done
mount -t tmpfs run /new/run
mkdir -p /new/dev/pts /new/dev/shm /new/out
mount -t devpts pts /new/dev/pts; mount -t tmpfs shm /new/dev/shm
mount -t 9p -o trans=virtio,version=9p2000.L,msize=262144 out /new/out
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root
# The layer becomes the root itself, not a folder that is seen as one: in a mere chroot no user namespace can be made.
cd /new && mount --move . /
chroot . /bin/bash -c '/bin/bash /out/.start; echo $? >/out/.status; echo 1 >/proc/sys/kernel/printk; sync'
poweroff -f
INIT
  chmod +x "$work/init"
  (cd "$work" && find . | cpio -o -H newc --quiet | gzip -1) >"$work.gz"
  mv "$work.gz" "$cache/initrd.gz"
  rm -rf "$work"
}

prepare() {
  mkdir -p "$cache"
  install_tools
  [ -e "$cache/kernel/vmlinuz" ] || fetch_kernel
  make_initrd
}

modules= out= seconds=300 cpus=2 memory_mb=1536 kvm=no
while [ $# -gt 0 ]; do
  case $1 in
    -h|--help) usage; exit 0 ;;
    --prepare) prepare; exit 0 ;;
    --kvm) kvm=yes; shift ;;
    --modules|--out|--seconds|--cpus|--memory-mb)
      [ $# -ge 2 ] || wrong "$1 needs a value"
      case $1 in
        --modules) modules=$2 ;; --out) out=$2 ;; --seconds) seconds=$2 ;; --cpus) cpus=$2 ;; --memory-mb) memory_mb=$2 ;;
      esac
      shift 2 ;;
    -*) wrong "there is no option $1" ;;
    *) break ;;
  esac
done
[ $# -ge 1 ] || wrong "no script is named"
script=$(realpath -e -- "$1" 2>/dev/null) || wrong "there is no script $1"
shift
[ "$(uname -m)" = x86_64 ] || cannot "only x86-64 machines are supported"
for tool in qemu-system-x86_64 modprobe; do
  PATH=$PATH:/usr/sbin:/sbin command -v $tool >/dev/null || cannot "$tool is not installed; run: bash tests/system/vm.sh --prepare"
done
[ -e "$cache/initrd.gz" ] || cannot "no kernel is in $cache; run: bash tests/system/vm.sh --prepare"

remove=
[ -n "$out" ] || { out=$(mktemp -d); remove=$out; }
mkdir -p "$out" && out=$(realpath "$out")
trap '[ -z "$remove" ] || rm -rf "$remove"' EXIT
rm -f "$out/.status"
{
  printf 'cd %q\n' "$PWD"
  for module in $modules; do
    printf 'modprobe -d %q %q || { echo "vm: no module %s"; exit 97; }\n' "$cache/kernel" "$module" "$module"
  done
  printf 'exec /bin/bash'
  printf ' %q' "$script" "$@"
  printf '\n'
} >"$out/.start"

accelerate=(-accel tcg,thread=multi)
[ "$kvm" = no ] || accelerate=(-accel kvm)
timed=0
timeout "$seconds" qemu-system-x86_64 "${accelerate[@]}" -cpu max -smp "$cpus" -m "$memory_mb" -nodefaults -display none -no-reboot \
  -serial stdio -kernel "$cache/kernel/vmlinuz" -initrd "$cache/initrd.gz" \
  -append "console=ttyS0 quiet loglevel=1 panic=-1 mitigations=off" \
  -fsdev local,id=host,path=/,security_model=none,readonly=on,multidevs=remap -device virtio-9p-pci,fsdev=host,mount_tag=host \
  -fsdev local,id=out,path="$out",security_model=none -device virtio-9p-pci,fsdev=out,mount_tag=out </dev/null 2>&1 |
  sed -u 's|\r||g' || timed=${PIPESTATUS[0]}
[ "$timed" != 124 ] || { echo "vm: out of time after $seconds s" >&2; exit 98; }
status=$(cat "$out/.status" 2>/dev/null || echo 99)
rm -f "$out/.status" "$out/.start"
exit "$status"
