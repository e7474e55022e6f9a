//! Makes the messages from `jetlink.xml`.

use mavlink_bindgen::{XmlDefinitions, generate};
use std::path::Path;

fn main() -> Result<(), String> {
    let out = std::env::var("OUT_DIR").map_err(|error| error.to_string())?;
    println!("cargo::rerun-if-changed=jetlink.xml");
    println!("cargo::rerun-if-changed=build.rs");
    // The generator guards each dialect with a feature. There is one here, always on.
    println!("cargo::rustc-cfg=feature=\"dialect-jetlink\"");
    // What it writes for its own users, and is never on here.
    println!(
        "cargo::rustc-check-cfg=cfg(feature, values(\"dialect-jetlink\", \"serde\", \"arbitrary\", \"ts-rs\"))"
    );
    let xml = XmlDefinitions::Files(vec![Path::new("jetlink.xml")]);
    generate(xml, Path::new(&out)).map(|_| ()).map_err(|error| format!("jetlink.xml: {error}"))
}
