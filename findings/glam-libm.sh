#!/usr/bin/env bash
# glam 0.30.10: with its features `std` and `libm` together, `libm` wins, so that Vec3::length() calls a software
# square root on x86-64; with `std` alone it is the instruction sqrtss. Features of one dependency add up in a build:
# one crate that asks for `libm`, say for another target, slows down every other one.
#
# Seen with Rust 1.95.0 on x86-64: `std` alone 1 sqrtss and no call of libm; both 0 sqrtss and a call of libm's sqrtf.
# A renderer spent 12 % of its time in that function. Fails if that is no longer so. Needs cargo and crates.io.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
mkdir src
cat > src/lib.rs <<'RUST'
#[unsafe(no_mangle)]
pub fn length_of(v: &glam::Vec3) -> f32 {
    v.length()
}
RUST

# The body of `length_of` under some features of glam.
body() {
    cat > Cargo.toml <<TOML
[package]
name = "probe"
version = "0.0.0"
edition = "2024"

[dependencies]
glam = { version = "=0.30.10", default-features = false, features = [$1] }

[lib]
crate-type = ["lib"]
TOML
    cargo rustc --quiet --release --lib -- --emit asm -Ccodegen-units=1
    awk '/^length_of:/ { inside = 1 } inside { print } /\.cfi_endproc/ { inside = 0 }' target/release/deps/probe-*.s
    rm -rf target
}

alone=$(body '"std"')
both=$(body '"std", "libm"')
echo "std:       $(grep -c sqrtss <<<"$alone" || true) sqrtss, $(grep -c libm <<<"$alone" || true) uses of libm"
echo "std, libm: $(grep -c sqrtss <<<"$both" || true) sqrtss, $(grep -c libm <<<"$both" || true) uses of libm"
grep -q sqrtss <<<"$alone" && ! grep -q libm <<<"$alone"
! grep -q sqrtss <<<"$both" && grep -q libm <<<"$both"
