//! Compiles the C++ side of the bridge into this crate's archive, and writes the constants that C++ shares.

use std::env;
use std::fs;

#[path = "src/constants.rs"]
mod constants;

fn main() {
    cxx_build::bridge("src/bridge.rs").std("c++17").flag_if_supported("-march=haswell").compile("sgtd_bridge");
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=src/bridge.rs");
    println!("cargo:rerun-if-changed=src/constants.rs");
    // a build of the plugin says where its header belongs
    println!("cargo:rerun-if-env-changed=SGTD_CONSTANTS");
    if let Some(path) = env::var_os("SGTD_CONSTANTS") {
        fs::write(&path, header()).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    }
}

/// `sgtd_constants.h`. What enters arithmetic of single precision is a float, as a literal is.
fn header() -> String {
    use constants::*;
    let single = |x: f64| format!("{x:?}f");
    let list = |values: &[f64]| format!("{{ {} }}", values.iter().map(|&x| single(x)).collect::<Vec<_>>().join(", "));
    let lists = AZIMUTH_FITS.map(|fit| list(&fit)).join(", ");
    let declarations = [
        format!("double LeastAlpha = {LEAST_ALPHA:?}"),
        format!("double DefaultAccuracy = {DEFAULT_ACCURACY:?}"),
        format!("uint32_t MaskingEntries = {MASKING_ENTRIES}"),
        format!("uint32_t VisibleCells = {CELLS}, VisibleRows = {VIEW_ROWS}, VisibleBlock = {BLOCK}"),
        format!("float LeastShare = {}", single(LEAST_SHARE)),
        format!("float HorizonMargin = {}", single(HORIZON_MARGIN)),
        format!("float AzimuthFits[2][{}] = {{ {lists} }}", AZIMUTH_FITS[0].len()),
        format!("float AzimuthSteep = {}", single(AZIMUTH_STEEP)),
        format!("float AzimuthSteepFit[] = {}", list(&AZIMUTH_STEEP_FIT)),
        format!("float AzimuthFlatFit[] = {}", list(&AZIMUTH_FLAT_FIT)),
        format!("uint32_t AverageNodes = {AVERAGE}, MissingEnergyPacket = {PACKET}"),
        format!("uint32_t InterfaceOctaves = {INTERFACE_OCTAVES}, InterfaceCells = {INTERFACE_CELLS}"),
    ];
    let lines: String = declarations.iter().map(|line| format!("constexpr {line};\n")).collect();
    format!(
        "// Written by rust-core/build.rs from rust-core/src/constants.rs, which says what each is.\n#pragma once\n\n\
         #include <cstdint>\n\nnamespace sgtd::host {{\n\n{lines}\n}} // namespace sgtd::host\n"
    )
}
