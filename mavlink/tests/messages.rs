//! The generator makes `src/messages.rs` from `jetlink.xml`. The file is committed, because otherwise every first build would include
//! the generator and its dependencies.

use mavlink_bindgen::{XmlDefinitions, generate};
use std::path::Path;

/// Rewrite it with `JETLINK_WRITE_MESSAGES=1 cargo test --package jetlink-mavlink --test messages`.
#[test]
fn the_messages_are_generated_from_the_definitions() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let out = Path::new(env!("CARGO_TARGET_TMPDIR"));
    generate(XmlDefinitions::Files(vec![root.join("jetlink.xml")]), out).expect("jetlink.xml");
    let raw = std::fs::read_to_string(out.join("jetlink.rs")).expect("the generated file");
    let generated = prettyplease::unparse(&syn::parse_file(&raw).expect("Rust"));
    let path = root.join("src/messages.rs");
    if std::env::var_os("JETLINK_WRITE_MESSAGES").is_some() {
        std::fs::write(&path, &generated).expect("it can be written");
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(committed == generated, "src/messages.rs is not what jetlink.xml gives");
}
