#!/usr/bin/env bash
# Builds a Rust toolchain that compiles Rust to SPIR-V from Debian's and cargo's packages alone: rustc 1.96.0 with
# its internal crates (what rustup calls rustc-dev), and rust-gpu's code generator rustc_codegen_spirv on top.
# `cargo xtask toolchain` runs it where rustup can install nothing, and links the result.
#
#   debian-toolchain.sh DEST RUST_GPU_VERSION [WORK]
#
# DEST is the toolchain's folder; WORK is scratch, 8 GB, kept if named. Needs Debian bookworm with its security
# suite, x86_64, root for apt-get, cargo 1.95 or newer. About 20 minutes on 2 cores.
set -euo pipefail

usage='usage: debian-toolchain.sh DEST RUST_GPU_VERSION [WORK]'
dest=$(realpath -m "${1:?$usage}")
rust_gpu=${2:?$usage}
if [ -n "${3:-}" ]; then
    work=$(realpath -m "$3")
else
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
fi

version=1.96.0
host=x86_64-unknown-linux-gnu
cargo=$(rustup which cargo 2>/dev/null || command -v cargo)
# Debian's rustc, which compiles the new one, and its sources.
stage0=$work/root/usr
sources=$stage0/src/rustc-$version
# Where cargo puts the new rustc and its crates.
built=$work/target/$host/release
# The internal crates that only the code generator's build needs.
rustc_dev=$work/rustc-dev
lib=$dest/lib/rustlib/$host/lib

main() {
    step "Debian's rustc $version with its sources, and LLVM"
    get_packages
    step "rustc $version, built by itself so that its internal crates can be linked against"
    build_rustc
    step "its folder $dest"
    assemble
    step "rustc_codegen_spirv $rust_gpu"
    build_code_generator
    step "without what only that build needed"
    slim
    "$dest/bin/rustc" --version
}

step() { printf '\n== %s\n' "$*"; }

get_packages() {
    local packages=(rustc-web libstd-rust-web-1.96 libstd-rust-web-dev rust-web-src) deb
    apt-get update -qq
    apt-get install -y -qq llvm-22-dev libllvm22 cmake g++ pkg-config >/dev/null
    mkdir -p "$work/debs" "$work/root"
    # Unpacked, not installed: they would get in the way of the machine's own Rust. Apt's warning that it cannot
    # drop its privileges in this folder is of no interest.
    (cd "$work/debs" && apt-get download -qq "${packages[@]}" 2>"$work/apt.log") || {
        cat "$work/apt.log" >&2
        return 1
    }
    for deb in "$work"/debs/*.deb; do dpkg -x "$deb" "$work/root"; done
}

build_rustc() {
    local workspace=$work/rustc
    mkdir -p "$workspace"
    cp -r "$sources"/{compiler,library,src,Cargo.lock} "$workspace/"
    cat >"$workspace/Cargo.toml" <<TOML
[workspace]
resolver = "2"
members = ["compiler/rustc"]
exclude = ["compiler/rustc_codegen_cranelift", "compiler/rustc_codegen_gcc", "src/bootstrap"]
[profile.release]
opt-level = 2
codegen-units = 16
TOML
    # In a subshell, for the variables' sake.
    (
        export LD_LIBRARY_PATH=$stage0/lib/x86_64-linux-gnu
        export RUSTC=$stage0/bin/rustc RUSTC_BOOTSTRAP=1 CARGO_TARGET_DIR=$work/target
        # The same version string as Debian's, so that both read each other's crates.
        CFG_VERSION=$("$RUSTC" --version | sed 's/^rustc //')
        CFG_VER_HASH=$("$RUSTC" -vV | sed -n 's/^commit-hash: //p')
        CFG_VER_DATE=$("$RUSTC" -vV | sed -n 's/^commit-date: //p')
        export CFG_VERSION CFG_VER_HASH CFG_VER_DATE CFG_SHORT_VER_HASH=${CFG_VER_HASH:0:9}
        # What rustc's own build system would set.
        export CFG_RELEASE=$version CFG_RELEASE_CHANNEL=nightly
        export CFG_COMPILER_HOST_TRIPLE=$host CFG_LIBDIR_RELATIVE=lib RUSTC_INSTALL_BINDIR=bin
        export CFG_DEFAULT_CODEGEN_BACKEND=llvm DOC_RUST_LANG_ORG_CHANNEL=https://doc.rust-lang.org/$version
        export REAL_LIBRARY_PATH_VAR=LD_LIBRARY_PATH REAL_LIBRARY_PATH=
        export LLVM_CONFIG=/usr/bin/llvm-config-22 LLVM_LINK_SHARED=1
        export RUSTFLAGS="--cap-lints allow -Zforce-unstable-if-unmarked -Clink-arg=-Wl,-rpath,\$ORIGIN/../lib"
        cd "$workspace"
        # --target keeps the crates of build scripts apart from the compiler's own.
        "$cargo" build --release --package rustc-main --features llvm --target "$host"
    )
}

assemble() {
    rm -rf "$dest"
    mkdir -p "$dest/bin" "$lib" "$dest/lib/rustlib/src/rust" "$dest/lib/rustlib/rustc-src/rust/compiler" "$rustc_dev"
    cp "$built/rustc-main" "$dest/bin/rustc"
    ln -sf "$cargo" "$dest/bin/cargo"
    cp "$built/deps/librustc_driver.so" "$dest/lib/"
    ln -sf ../../../librustc_driver.so "$lib/librustc_driver.so"
    cp "$stage0/lib/rustlib/$host/lib/"*.{rlib,rmeta} "$lib/"
    cp "$built"/deps/*.{rlib,rmeta} "$work/target/release/deps/"*.so "$rustc_dev/"
    cp "$rustc_dev/"* "$lib/"
    cp -r "$sources/library" "$dest/lib/rustlib/src/rust/"
    cp -r "$sources/compiler/rustc_codegen_ssa" "$dest/lib/rustlib/rustc-src/rust/compiler/"
}

build_code_generator() {
    local package=$work/backend
    mkdir -p "$package/src"
    : >"$package/src/lib.rs"
    cat >"$package/Cargo.toml" <<TOML
[package]
name = "backend"
edition = "2021"
[workspace]
[dependencies]
rustc_codegen_spirv = "=$rust_gpu"
TOML
    # The check asks for rustup's nightly by name; this rustc is of the same version.
    (cd "$package" && RUSTC=$dest/bin/rustc RUSTC_BOOTSTRAP=1 RUSTGPU_SKIP_TOOLCHAIN_CHECK=1 \
        "$cargo" build --release --target-dir "$work/backend-target")
    cp "$work"/backend-target/release/deps/librustc_codegen_spirv-*.so "$dest/lib/librustc_codegen_spirv.so"
}

slim() {
    local file
    for file in "$rustc_dev/"*; do rm -f "$lib/$(basename "$file")"; done
    rm -rf "$dest/lib/rustlib/rustc-src"
    strip --strip-unneeded "$dest/lib/librustc_driver.so" "$dest/lib/librustc_codegen_spirv.so"
}

main
