//! `cargo fw`: the features of the firmware.

use boards::BOARDS;

/// The manifest of the firmware.
const MANIFEST: &str = include_str!("../../Cargo.toml");

/// What `cargo fw --help` prints.
pub fn help() -> String {
    let boards = BOARDS.map(|board| format!("  board-{}\n", board.name)).concat();
    let others = names().filter(|name| !name.starts_with("board-")).map(|name| format!("  {name}\n"));
    let others: String = others.collect();
    format!(
        "Builds the firmware for a board, with the pinned Rust\n\nUsage: cargo fw FEATURES [OPTIONS OF CARGO BUILD]...\n\n\
         FEATURES is a board, and further features after commas, as Cargo.toml describes them.\n\nBoards:\n{boards}\n\
         Further features:\n{others}"
    )
}

/// Features of the firmware, from its manifest.
fn names() -> impl Iterator<Item = &'static str> {
    let lines = MANIFEST.lines().skip_while(|line| *line != "[features]").skip(1);
    let lines = lines.take_while(|line| !line.starts_with('['));
    lines
        .filter_map(|line| line.split_once(" = ["))
        .map(|(name, _)| name)
        .filter(|name| !name.starts_with('#'))
}

/// Refuses features that the firmware does not have.
pub fn check(features: &str) -> Result<(), String> {
    match features.split(',').find(|feature| !names().any(|name| name == *feature)) {
        None => Ok(()),
        Some(feature) => Err(format!("the firmware has no feature `{feature}`; {}", boards())),
    }
}

/// The sentence that names the boards.
pub fn boards() -> String {
    let boards = BOARDS.map(|board| format!("cargo fw board-{}", board.name)).join(", ");
    format!("name a board: {boards}; add further features after a comma")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_features_are_those_of_the_manifest() {
        for features in [
            "board-pixracer",
            "board-matek-h743,demo",
            "trial",
            "count",
            "board-cube-orange,ardupilot-bootloader",
        ] {
            assert_eq!(check(features), Ok(()), "{features}");
        }
        for (features, wrong) in [
            ("board-pixracr", "`board-pixracr`"),
            ("pixracer", "`pixracer`"),
            ("board-pixracer,dmo", "`dmo`"),
            ("board-pixracer,", "``"),
        ] {
            assert!(check(features).is_err_and(|why| why.contains(wrong)), "{features}");
        }
        let help = help();
        assert!(BOARDS.iter().all(|board| help.contains(&format!("\n  board-{}\n", board.name))), "{help}");
        assert!(help.contains("\n  demo\n") && !help.contains("profile"), "{help}");
    }
}
