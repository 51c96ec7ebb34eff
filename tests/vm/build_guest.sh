# Builds the guest: Debian's kernel and modules, modules of ours, an initramfs. Sourced by
# tests/vm/guest; needs no root, but for installing packages.

# build_guest: sets `guest` to the folder with vmlinuz, initramfs, modules/ and release. Skips where
# the packages are not to be had.
build_guest() {
  [[ $(uname -m) == x86_64 ]] || skip "the guest's kernel is for x86-64, this computer is $(uname -m)"
  local said
  said=$("$root/scripts/install-packages" vm 2>&1) || skip "packages: $(tail -n 1 <<<"$said")"
  [[ -z $said ]] || echo "$said" >&2

  local cache=${XDG_CACHE_HOME:-$HOME/.cache}/waymark/guest release
  release=$(guest_release)
  mkdir -p "$cache" 2>/dev/null || fail "$cache: cannot be made"
  guest=$cache/$(guest_inputs "$release" | sha256sum | cut -c1-16)
  # Two tests may begin at the same time.
  exec {lock}>"$cache/lock"
  flock "$lock"
  if [[ ! -d $guest ]]; then
    echo "guest: building it, Linux $release; some minutes, once" >&2
    rm -rf "$guest.new"
    mkdir -p "$guest.new"
    unpack_kernel "$guest.new" "$release"
    build_modules "$guest.new" "$release"
    build_initramfs "$guest.new" "$release"
    echo "$release" >"$guest.new/release"
    mv "$guest.new" "$guest"
  fi
  touch "$guest"
  # Guests of other inputs go when nobody has used them for a month.
  find "$cache" -mindepth 1 -maxdepth 1 -type d -mtime +30 -exec rm -rf {} +
  exec {lock}>&-
}

# The kernel whose headers are installed: "6.1.0-49-amd64".
guest_release() {
  dpkg-query -W -f '${Depends}\n' linux-headers-amd64 | grep -o '[0-9][^ ]*-amd64' | head -n 1
}

# All that the guest is made from.
guest_inputs() {
  echo "$1"
  dpkg-query -W linux-headers-amd64 linux-source-6.1 busybox-static
  cat "$here/build_guest.sh" "$here/init" "$here"/modules/*
}

# quietly LOG COMMAND...: shows what it said only where it fails.
quietly() {
  local log=$1
  shift
  "$@" >"$log" 2>&1 && return
  tail -n 30 "$log" | sed 's/^/  /' >&2
  echo "guest: cannot be built: '$*' failed, see above" >&2
  exit 1
}

# The package is unpacked and never installed: the computer keeps its kernel.
unpack_kernel() {
  local to=$1 release=$2 said
  said=$(cd "$to" && apt-get -q download "linux-image-$release" 2>&1) ||
    skip "linux-image-$release: $(grep -m 1 '^E:' <<<"$said"); a newer linux-headers-amd64 may help"
  dpkg -x "$to"/linux-image-*.deb "$to/unpacked"
  mv "$to/unpacked/boot/vmlinuz-$release" "$to/vmlinuz"
  # depmod wants them where the guest will have them.
  mkdir -p "$to/tree/usr/lib/modules"
  ln -s usr/lib "$to/tree/lib"
  mv "$to/unpacked/lib/modules/$release" "$to/tree/usr/lib/modules/"
  ln -s tree/usr/lib/modules "$to/modules"
  rm -rf "$to"/linux-image-*.deb "$to/unpacked"
}

# vimc, which Debian leaves out, and what is in modules/.
build_modules() {
  local to=$1 release=$2 build=$1/build
  local headers=/usr/src/linux-headers-$release
  [[ -d $headers ]] || skip "$headers: no such folder; linux-headers-amd64 is not whole"
  mkdir "$build"
  quietly "$build/tar.log" tar -xf /usr/src/linux-source-6.1.tar.xz -C "$build" \
    --strip-components=4 linux-source-6.1/drivers/media/test-drivers/vimc
  cp -r "$here/modules" "$build/waymark"
  quietly "$build/vimc.log" make -C "$headers" M="$build/vimc" CONFIG_VIDEO_VIMC=m modules
  quietly "$build/waymark.log" make -C "$headers" M="$build/waymark" modules
  mkdir "$to/modules/$release/extra"
  cp "$build"/*/*.ko "$to/modules/$release/extra/"
  rm -rf "$build"
  quietly "$to/depmod.log" depmod -b "$to/tree" "$release"
}

# busybox, init, and the modules without which there are no files.
build_initramfs() {
  local to=$1 release=$2 staging=$1/staging module file
  mkdir -p "$staging"/{bin,modules,proc,sys,dev,lower,share,upper,new}
  cp /bin/busybox "$staging/bin/"
  install -m 755 "$here/init" "$staging/init"
  for module in virtio_pci 9pnet_virtio 9p overlay; do
    modprobe -d "$to/tree" -S "$release" --show-depends "$module" | sed -n 's/^insmod //p'
  done | awk '!seen[$1]++ { print $1 }' | while read -r file; do
    cp "$file" "$staging/modules/"
    basename "$file" >>"$staging/modules/order"
  done
  (cd "$staging" && find . | cpio -o -H newc --quiet -R 0:0 | gzip -1) >"$to/initramfs"
  rm -rf "$staging"
}
