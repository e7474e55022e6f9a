//! ZK-Protocol V1.2.
//!
//! The host sends a 4-byte command in every send slot. Up to protocol version 4 the ECU answers each; from
//! version 5 it sends its status unprompted and keeps its last running state when commands stop.

pub mod codec;
pub mod config;
pub mod link;
mod mode;
mod service;
mod status;
