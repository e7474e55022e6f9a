//! The firmware's image: built with cargo, read as an ELF.

use object::{Object, ObjectSection};
use std::path::PathBuf;
use std::process::{Command, Stdio};

const TARGET: &str = "thumbv7em-none-eabihf";

/// An image and where it lies.
pub struct Image {
    pub path: PathBuf,
    pub elf: Vec<u8>,
}

impl Image {
    /// Builds the firmware with these features.
    pub fn build(features: &[&str]) -> Result<Self, String> {
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let output = Command::new(cargo)
            .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
            .args(["build", "--release", "--target", TARGET, "--package", "jetlink", "--bin", "jetlink-fw"])
            .args(["--features", &features.join(","), "--message-format", "json-render-diagnostics"])
            .stderr(Stdio::inherit())
            .output()
            .map_err(|why| format!("cargo cannot be started: {why}"))?;
        if !output.status.success() {
            return Err(format!(
                "the firmware does not build. Is its target installed? rustup target add {TARGET}"
            ));
        }
        let path: PathBuf = String::from_utf8_lossy(&output.stdout)
            .lines()
            .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok())
            .filter_map(|message| Some(message.get("executable")?.as_str()?.into()))
            .next_back()
            .ok_or("cargo built no firmware")?;
        let elf = std::fs::read(&path).map_err(|why| format!("{}: {why}", path.display()))?;
        Ok(Self { path, elf })
    }

    fn file(&self) -> Result<object::File<'_>, String> {
        object::File::parse(&*self.elf).map_err(|why| format!("{}: {why}", self.path.display()))
    }

    /// The vector table: the initial stack pointer, then a handler for each exception and interrupt.
    pub fn vectors(&self) -> Result<Vec<u32>, String> {
        let file = self.file()?;
        let table = file.section_by_name(".vector_table").ok_or("the image has no vector table")?;
        let bytes = table.data().map_err(|why| why.to_string())?;
        Ok(bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect())
    }

    /// Where the instruction WFE is, and whatever else in the code looks like it.
    pub fn wait_instructions(&self) -> Result<Vec<u32>, String> {
        const WFE: [u8; 2] = 0xBF20_u16.to_le_bytes();
        let file = self.file()?;
        let text = file.section_by_name(".text").ok_or("the image has no code")?;
        let bytes = text.data().map_err(|why| why.to_string())?;
        let base = u32::try_from(text.address()).map_err(|why| why.to_string())?;
        Ok((base..)
            .step_by(2)
            .zip(bytes.as_chunks().0)
            .filter(|(_, code)| **code == WFE)
            .map(|(at, _)| at)
            .collect())
    }
}
