//! The messages, generated from `jetlink.xml` by `build.rs`. No field is an enumeration: an unknown number would cost the
//! whole message.
#![allow(missing_docs, unused_imports, unexpected_cfgs, dead_code, non_camel_case_types, non_snake_case)]
#![allow(clippy::all, reason = "generated")]

mod generated {
    include!(concat!(env!("OUT_DIR"), "/mod.rs"));
}

pub use self::generated::jetlink::*;
