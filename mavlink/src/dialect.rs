//! The messages, generated from `jetlink.xml`: `tests/messages.rs` writes and compares them. No field is an enumeration: an
//! unknown number would cost the whole message.
#![allow(missing_docs, unused_imports, dead_code, non_camel_case_types, non_snake_case)]
#![allow(clippy::all, reason = "generated")]

#[rustfmt::skip]
#[path = "messages.rs"]
mod messages;

pub use self::messages::*;
