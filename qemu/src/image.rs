//! The firmware's image, built with cargo.

use commands::qemu::Arguments;
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// An image and its path.
pub struct Image {
    pub path: PathBuf,
    pub elf: Vec<u8>,
}

impl Image {
    /// Builds the firmware with this feature and those of the command line.
    pub fn build(feature: &str, arguments: &Arguments) -> Result<Self, String> {
        let features: Vec<&str> = [feature].into_iter().chain(arguments.features.as_deref()).collect();
        // By name and by its alias: $CARGO may be another Rust than the one that every image is built with.
        let output = Command::new("cargo")
            .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
            .args(["fw", &features.join(","), "--message-format", "json-render-diagnostics"])
            .stderr(Stdio::inherit())
            .output()
            .map_err(|why| format!("cannot start cargo: {why}"))?;
        if !output.status.success() {
            return Err("building the firmware failed, see above".into());
        }
        let path: PathBuf = String::from_utf8_lossy(&output.stdout)
            .lines()
            .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok())
            .filter_map(|message| Some(message.get("executable")?.as_str()?.into()))
            .next_back()
            .ok_or("cargo reported no executable")?;
        let elf = std::fs::read(&path).map_err(|why| format!("{}: {why}", path.display()))?;
        Ok(Self { path, elf })
    }
}
