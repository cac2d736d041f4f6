//! Do imports go one way only, from room to room as ARCHITECTURE.md draws them?

use std::fs;
use std::path::Path;

/// Rooms, ground floor first; those of one line know nothing of each other.
const FLOORS: &[&[&str]] = &[
    &["constants", "error"],
    &["numerics"],
    &["profile"],
    &["family"],
    &["radial", "masking"],
    &["sampling"],
    &["ndf"],
    &["scattering", "batch"],
    &["microsurface"],
    &["bridge"],
];

fn floor(room: &str) -> usize {
    let found = FLOORS.iter().position(|rooms| rooms.contains(&room));
    found.unwrap_or_else(|| panic!("src/{room} is on no floor: add it to tests/rooms.rs and ARCHITECTURE.md"))
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Every file below a folder, with the room it is in.
fn files(folder: &Path, room: Option<&str>, found: &mut Vec<(String, String, String)>) {
    let entries = fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    for entry in entries {
        let path = entry.unwrap_or_else(|error| panic!("{}: {error}", folder.display())).path();
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let room = room.unwrap_or(&stem);
        if path.is_dir() {
            files(&path, Some(room), found);
        } else if room != "lib" {
            found.push((room.to_owned(), path.display().to_string(), read(&path)));
        }
    }
}

#[test]
fn imports_go_down_only() {
    let mut all = Vec::new();
    files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), None, &mut all);
    let mut imports = 0;
    for (room, path, text) in &all {
        for line in text.lines().filter(|line| !line.trim_start().starts_with("//")) {
            for (at, _) in line.match_indices("crate::") {
                let rest = &line[at + "crate::".len()..];
                let used: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                assert!(!used.is_empty(), "{path}: {line}: name one room per import");
                assert!(
                    used == *room || floor(&used) < floor(room),
                    "{path} imports {used}, which is not below {room}"
                );
                imports += usize::from(used != *room);
            }
        }
    }
    assert!(imports > 50, "only {imports} imports found: the reader is broken");
    // and every room is there
    for room in FLOORS.iter().copied().flatten() {
        assert!(all.iter().any(|(found, _, _)| found == room), "there is no room {room}");
    }
}

/// The drawing has the rooms in this order.
#[test]
fn the_drawing_has_every_room() {
    let text = read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../ARCHITECTURE.md"));
    let line = text.lines().find(|line| line.trim_start().starts_with("numerics ─►"));
    let line = line.unwrap_or_else(|| panic!("ARCHITECTURE.md has no line that begins with numerics"));
    let mut last = 0;
    for room in FLOORS.iter().skip(1).copied().flatten() {
        let at = line.find(room).unwrap_or_else(|| panic!("ARCHITECTURE.md does not draw {room}: {line}"));
        assert!(at >= last, "ARCHITECTURE.md draws {room} too early: {line}");
        last = at;
    }
}
