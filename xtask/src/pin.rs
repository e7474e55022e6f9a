//! The pinned toolchain of `pinned-toolchain.toml`.

const FILE: &str = include_str!("../pinned-toolchain.toml");

/// Its version, for example `1.98.0`.
pub fn version() -> &'static str {
    string("channel")
}

/// The firmware's target.
pub fn target() -> &'static str {
    string("targets")
}

/// The first string of a key. The tests check that there is one.
fn string(key: &str) -> &'static str {
    let value = FILE.lines().find_map(|line| line.strip_prefix(key)?.trim_start().strip_prefix('='));
    value.and_then(|value| value.split('"').nth(1)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines of a file without comments.
    fn settings(file: &str) -> Vec<&str> {
        file.lines().filter(|line| !line.starts_with('#')).collect()
    }

    #[test]
    fn the_pin_is_an_exact_version_and_the_target_that_of_both_chips() {
        let numbers: Vec<u32> =
            version().split('.').map(|number| number.parse().expect("a number")).collect();
        assert_eq!(numbers.len(), 3, "{}", version());
        assert_eq!(target(), "thumbv7em-none-eabihf");
    }

    #[test]
    fn emulation_has_the_same_toolchain() {
        let emulation = include_str!("../../emulation/rust-toolchain.toml");
        assert_eq!(settings(emulation), settings(FILE));
        let manifest = include_str!("../../emulation/Cargo.toml");
        let minor = version().rsplit_once('.').expect("three numbers").0;
        let least = format!("rust-version = \"{minor}\"");
        assert!(manifest.lines().any(|line| line == least), "emulation/Cargo.toml does not say {least}");
    }
    /// Every version and every target in the settings of rust-analyzer.
    #[test]
    fn rust_analyzer_has_the_same_toolchain() {
        let host = include_str!("../../.vscode/settings.json");
        let firmware = include_str!("../../.vscode/target.code-workspace");
        let is_version = |word: &&str| {
            word.split('.').count() == 3 && word.split('.').all(|number| number.parse::<u32>().is_ok())
        };
        for (file, versions, targets) in [(host, 1, 0), (firmware, 2, 3)] {
            let words = || file.split('"').map(|word| word.trim_start_matches('+'));
            assert_eq!(words().filter(is_version).collect::<Vec<_>>(), vec![version(); versions]);
            let found: Vec<_> = words().filter(|word| word.starts_with("thumb")).collect();
            assert_eq!(found, vec![target(); targets]);
        }
    }
}
