//! The tests of the library: codecs, links, engines, and random worlds against the invariants of the supervision.
//!
//! One binary, so that one change is linked once. `cargo test -p jetlink --test it amt_link::` runs one part.

mod amt_link;
mod channel;
mod codec_props;
mod config;
mod engine_commands;
mod engine_flame_out;
mod engine_governor;
mod engine_inputs;
mod engine_life;
mod engine_limits;
mod engine_rules;
mod engine_sources;
mod engine_start;
mod engine_state_table;
mod engine_stop;
mod engine_transmitter;
mod led_table;
mod reading_points;
mod runner_watch;
mod supervision;
mod support;
mod units;
mod vectors;
mod wiring;
mod zk_link;
