//! The firmware image on emulated boards. One program, so that the emulator is linked once.

mod support;

mod all_ports;
mod amt_frames;
mod ardupilot;
mod babble;
mod boot;
mod crystal;
mod cut;
mod driver;
mod endless_waits;
mod engine;
mod first_flash;
mod harness;
mod led;
mod line_errors;
mod mavlink;
mod memory_map;
mod other_boards;
mod outputs;
mod play_ecu;
mod power;
mod pulses;
mod radio;
mod repeat;
mod reply_time;
mod self_test;
mod stuck;
mod supply;
mod table;
mod tcp;
mod usb;
mod watchdog;
