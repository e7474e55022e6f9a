//! AMT serial control, version 20140617 (hardware V2.13, software Vx.35A and higher).
//!
//! The ECU sends unprompted, about 8 frames per second at 2400 baud. The host answers each frame within
//! 30 ms and sends nothing else. When the answers stop, the ECU stops the turbine.

pub mod codec;
pub mod config;
pub mod link;
