//! Compiles the C++ side of the bridge into this crate's archive.

fn main() {
    cxx_build::bridge("src/bridge.rs").std("c++17").flag_if_supported("-march=haswell").compile("sgtd_bridge");
    println!("cargo:rerun-if-changed=src/bridge.rs");
}
