//! A small reader of Rust sources: which functions are public, which tests exist, and which tests the documentation
//! names.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

/// Texts of all Rust files below a folder, with their names as modules.
fn sources(folder: &Path) -> Vec<(String, String)> {
    sources_below(folder, "")
}

fn sources_below(folder: &Path, room: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    let entries = fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    for entry in entries {
        let path = entry.unwrap_or_else(|error| panic!("{}: {error}", folder.display())).path();
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let name = if stem == "mod" { room.trim_end_matches("::").to_owned() } else { format!("{room}{stem}") };
        if path.is_dir() {
            found.extend(sources_below(&path, &format!("{name}::")));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            found.push((name, text));
        }
    }
    assert!(!found.is_empty(), "no sources below {}", folder.display());
    found
}

/// The identifier that follows `keyword` in a line.
fn name_after(line: &str, keyword: &str) -> Option<String> {
    let (_, rest) = line.split_once(keyword)?;
    let name: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    (!name.is_empty()).then_some(name)
}

/// The type that an `impl` line is for; traits are reported by their own declaration.
fn implemented(line: &str) -> Option<String> {
    let rest = line.strip_prefix("impl")?;
    if rest.contains(" for ") {
        return None;
    }
    let rest = if rest.starts_with('<') { rest.split_once('>')?.1 } else { rest };
    name_after(rest, " ")
}

/// `room::file::Type::function` of everything public, the methods of public traits included.
pub fn public_functions() -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (file, text) in sources(&folder("src")) {
        // the type or trait of the block that is open, and whether its functions are public without saying so
        let mut block: Option<(String, bool)> = None;
        for line in text.lines() {
            if line.starts_with("impl") {
                block = implemented(line).map(|name| (name, false));
            } else if line.starts_with("pub trait ") {
                block = name_after(line, "trait ").map(|name| (name, true));
            } else if line.starts_with('}') {
                block = None;
            }
            let trimmed = line.trim_start();
            let declared = ["pub fn ", "pub const fn "].iter().any(|start| trimmed.starts_with(start));
            let in_trait = trimmed.starts_with("fn ") && block.as_ref().is_some_and(|(_, public)| *public);
            if let (true, Some(name)) = (declared || in_trait, name_after(trimmed, "fn ")) {
                found.insert(match &block {
                    Some((of, _)) => format!("{file}::{of}::{name}"),
                    None => format!("{file}::{name}"),
                });
            }
        }
    }
    found
}

/// Names of all test functions.
pub fn tests() -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (_, text) in sources(&folder("tests")) {
        let mut marked = false;
        for line in text.lines().map(str::trim) {
            if line == "#[test]" {
                marked = true;
            } else if marked && let Some(name) = name_after(line, "fn ") {
                found.insert(name);
                marked = false;
            }
        }
    }
    found
}

/// Tests that the documentation of the sources refers to, as in "(test `name`)", with the file that does.
pub fn tests_that_are_referred_to() -> Vec<(String, String)> {
    let mut found = Vec::new();
    for (file, text) in sources(&folder("src")) {
        let joined: String =
            text.lines().map(|line| line.trim_start_matches(['/', '!', ' '])).collect::<Vec<_>>().join(" ");
        for (position, _) in joined.match_indices("test `") {
            found.extend(name_after(&joined[position..], "test `").map(|name| (file.clone(), name)));
        }
    }
    found
}
