//! The table of `[stationary]` in CONVENTIONS.md against the settings themselves.

use insnav_log::{ConfigError, config_text, parse_config};
use std::collections::BTreeMap;

/// Rows of the table: key, and unit, default and meaning.
fn table() -> BTreeMap<String, [String; 3]> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../CONVENTIONS.md");
    let text = std::fs::read_to_string(path).expect("it is part of the repository");
    let (_, section) = text.split_once("## `[stationary]`").expect("a section");
    let section = section.split("\n## ").next().expect("its text");
    let rows = section.lines().filter_map(|line| {
        let cells: Vec<&str> = line.strip_prefix("| `")?.split(" | ").collect();
        let [key, unit, default, meaning] = cells[..] else {
            panic!("four cells: {line}");
        };
        let cell = |text: &str| text.trim_matches([' ', '|', '`']).to_owned();
        Some((
            key.trim_end_matches('`').to_owned(),
            [cell(unit), cell(default), cell(meaning)],
        ))
    });
    rows.collect()
}

/// Every key that the settings accept, as the error about one that they do not has them.
fn known_keys() -> Vec<String> {
    let error = parse_config("[stationary]\nzzzzzzzzzzzzzzzzzzzz = 1", "x", &[]).unwrap_err();
    let ConfigError::UnknownKey { known, .. } = error else {
        panic!("{error}");
    };
    let bare = |key: &String| key.strip_prefix("stationary.").expect("of it").to_owned();
    known.iter().map(bare).collect()
}

#[test]
fn every_key_is_explained_and_no_other() {
    let table = table();
    let mut known = known_keys();
    known.sort();
    assert!(known.iter().any(|k| k == "mode"), "{known:?}");
    let told: Vec<String> = table.keys().cloned().collect();
    assert_eq!(told, known);
    for (key, [unit, _, meaning]) in &table {
        assert!(meaning.len() > 20, "{key}: {meaning}");
        // The unit is in the name.
        for (suffix, expected) in [
            ("deg_per_sqrt_hour", "°/√h"),
            ("m_per_s_per_sqrt_hour", "m/s/√h"),
            ("m_per_s_per_sqrt_hz", "m/s/√Hz"),
            ("deg_per_sqrt_hz", "°/√Hz"),
            ("sqrt_s", "m/√s"),
            ("window_s", "s"),
            ("entry_s", "s"),
            ("speed_m_per_s", "m/s"),
            ("velocity_sigma_m_per_s", "m/s"),
        ] {
            if key.ends_with(suffix) {
                assert_eq!(unit, expected, "{key}");
            }
        }
    }
}

/// A default in the table is the value that a fresh configuration has; those that depend begin with "as".
#[test]
fn defaults_are_those_of_the_settings() {
    let fresh: toml::Table = config_text(&Default::default()).parse().expect("TOML");
    let fresh = fresh["stationary"].as_table().expect("a section");
    for (key, [_, default, _]) in table() {
        match fresh.get(&key) {
            Some(value) => {
                let told: toml::Table = format!("x = {default}")
                    .parse()
                    .unwrap_or_else(|e| panic!("{key} = {default}: {e}"));
                assert_eq!(&told["x"], value, "{key}");
            }
            None => assert!(
                default.contains("as ") || default == "none",
                "{key}: {default}"
            ),
        }
    }
}
